// The JavaScript client, driven by JSON lines on standard input (tests/clients/driving.py).
import { createInterface } from "node:readline";

import { Client, ShepherdError, TransientError } from "../../../clients/javascript/shepherd-client.js";

const ARRAYS = { float32: Float32Array, uint8: Uint8Array };
let session = null;

const state = () => ({ key: session.key, seq: session.seq, agent: session.agent });

const operations = {
  async login({ key, url, patience }) {
    session = await new Client(key, { url, patience }).session();
    return state();
  },
  async resume({ key, url, patience, session: sessionKey, seq }) {
    session = new Client(key, { url, patience }).resume(sessionKey, seq);
    return state();
  },
  async state() {
    return state();
  },
  async step({ obs, dtype, action_mask: actionMask, ...options }) {
    const { action, seq, episodeReturn } = await session.step(array(obs, dtype), { actionMask, ...options });
    return { action, seq, episode_return: episodeReturn };
  },
  async act({ obs }) {
    return session.act(obs);
  },
  async observe({ obs, reward, ...options }) {
    return session.observe(obs, reward, options);
  },
  async close() {
    await session?.close();
    return null;
  },
};

/** Nested lists with their innermost lists as typed arrays. */
function array(obs, dtype) {
  if (!dtype) return obs;
  if (!Array.isArray(obs)) return Object.fromEntries(Object.entries(obs).map(([key, value]) => [key, array(value, dtype)]));
  return Array.isArray(obs[0]) ? obs.map((row) => array(row, dtype)) : new ARRAYS[dtype](obs);
}

async function answer({ op, ...request }) {
  try {
    return { result: await operations[op](request) };
  } catch (error) {
    if (!(error instanceof ShepherdError)) throw error;
    const { name: type, code, status, retryAfter, message } = error;
    return { error: { type, code, status, retry_after: retryAfter, message, transient: error instanceof TransientError } };
  }
}

for await (const line of createInterface({ input: process.stdin })) {
  process.stdout.write(JSON.stringify(await answer(JSON.parse(line))) + "\n");
}
