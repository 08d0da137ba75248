/**
 * A visitor with a real server and a real agent. tests/bored/test_modules.py starts both and says where they are:
 * SHEPHERD_URL, SHEPHERD_PUBLISHABLE_KEY, and SHEPHERD_API_KEY of the same agent, by which its returns are read.
 */
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { beforeEach, test } from "node:test";

import { Guide } from "../../js/guide.js";
import { Places } from "../../js/places.js";
import { Store } from "../../js/store.js";
import { Visitor } from "../../js/visitor.js";
import { Whereabouts } from "../../js/whereabouts.js";
import { Client, UnknownSession } from "../../vendor/shepherd-client.js";

const { SHEPHERD_URL: url, SHEPHERD_PUBLISHABLE_KEY: key, SHEPHERD_API_KEY: ownersKey } = process.env;
const NOWHERE = "http://127.0.0.1:9";
const NOON = new Date("2026-11-25T12:00:00Z");
const { places: list, streets } = JSON.parse(readFileSync(new URL("../../places.json", import.meta.url), "utf8"));
const places = new Places(list, streets, "");

// A browser says from which page a request comes; Node does not.
const plainFetch = globalThis.fetch;
globalThis.fetch = (address, options = {}) => {
  const headers = new Headers(options.headers);
  headers.set("Origin", new URL(address).origin);
  return plainFetch(address, { ...options, headers });
};

/** A phone's storage. */
class Storage extends Map {
  getItem = (name) => this.get(name) ?? null;
  setItem = (name, text) => void this.set(name, text);
  removeItem = (name) => void this.delete(name);
}

/** Somebody who opens the page on a phone; again with the same `storage` after a reload. */
function visit(storage, server = url) {
  const store = new Store(storage);
  const whereabouts = new Whereabouts(undefined, store, places);
  const client = new Client(key, { url: server, patience: server === NOWHERE ? 0 : 20 });
  const guide = new Guide(client, store);
  return { store, client, guide, visitor: new Visitor({ places, store, whereabouts, guide, clock: () => NOON }) };
}

/** The returns of all answered suggestions so far. */
async function returns() {
  const response = await plainFetch(`${url}/api/v1/agent/returns?format=csv`, { headers: { Authorization: `Bearer ${ownersKey}` } });
  assert.equal(response.status, 200);
  return (await response.text()).trim().split(/\r?\n/).slice(1).map((line) => Number(line.split(",")[3]));
}

let before = 0;
beforeEach(async () => {
  before = (await returns()).length;
});
const answered = async () => (await returns()).slice(before);

test("a place that is loved is a favourite, and the agent gets 1", async () => {
  const { visitor } = visit(new Storage());
  const { id, session, verdict } = await visitor.next();
  assert.ok(session);
  assert.equal(verdict, null);
  visitor.love();
  assert.deepEqual(visitor.favourites.map((place) => place.id), [id]);
  assert.deepEqual(await answered(), [], "the answer is held back while it can be taken back");
  assert.equal(await visitor.settle(), true);
  assert.deepEqual(await answered(), [1]);
});

test("a place that is dismissed gives 0, and the next one comes at once, in another session", async () => {
  const { visitor, store } = visit(new Storage());
  const first = await visitor.next();
  visitor.dismiss();
  const second = await visitor.next();
  assert.notEqual(second.id, first.id);
  assert.notEqual(second.session, first.session);
  assert.deepEqual(await answered(), []);
  visitor.dismiss(); // now the first is settled
  await visitor.next();
  assert.deepEqual(await answered(), [0]);
  assert.equal(store.read().seats.length, 2, "two sessions are enough");
});

test("a dismissal that is taken back never reaches the agent, and what came after waits", async () => {
  const { visitor } = visit(new Storage());
  const first = await visitor.next();
  visitor.dismiss();
  const second = await visitor.next();
  assert.ok(visitor.undo());
  assert.equal(visitor.current.id, first.id);
  visitor.love();
  assert.equal((await visitor.next()).id, second.id);
  await visitor.settle();
  assert.deepEqual(await answered(), [1]);
  assert.ok(!visitor.undo(), "what was sent stays");
});

test("after a reload an answer that was held back is sent, and the place is still there", async () => {
  const storage = new Storage();
  const first = visit(storage).visitor;
  await first.next();
  first.dismiss();
  const shown = await first.next();
  const { visitor } = visit(storage);
  assert.equal(visitor.current.id, shown.id);
  assert.equal(await visitor.settle(), true);
  visitor.love();
  await visitor.settle();
  assert.deepEqual(await answered(), [0, 1]);
});

test("while the server is away chance decides among what is open, and answers wait for it", async () => {
  const storage = new Storage();
  const { visitor } = visit(storage);
  await visitor.next();
  const away = visit(storage, NOWHERE).visitor;
  away.love();
  assert.equal(await away.settle(), false);
  const byChance = await away.next();
  assert.equal(byChance.session, null);
  away.dismiss();
  const back = visit(storage).visitor;
  assert.equal(await back.settle(), true);
  assert.deepEqual(await answered(), [1], "nobody learns from what chance has suggested");
  assert.ok((await back.next()).session);
});

test("a session that is gone is replaced", async () => {
  const { visitor, client, store } = visit(new Storage());
  const { session } = await visitor.next();
  await client.resume(session, 0).close();
  visitor.dismiss();
  const next = await visitor.next();
  assert.ok(next.session && next.session !== session);
  await visitor.settle();
  assert.deepEqual(store.read().seats.map((seat) => seat.key), [next.session]);
});

test("forgetting closes the sessions at the server and leaves nothing", async () => {
  const storage = new Storage();
  const { visitor, client } = visit(storage);
  const { session } = await visitor.next();
  visitor.love();
  assert.equal(await visitor.forget(), true);
  assert.deepEqual([...storage.values()], []);
  await assert.rejects(client.resume(session, 1).step(Array(29).fill(0)), UnknownSession);
});

test("where the server cannot be told, the keys are kept until it can", async () => {
  const storage = new Storage();
  const { session } = await visit(storage).visitor.next();
  assert.equal(await visit(storage, NOWHERE).visitor.forget(), false);
  const { guide, store, client } = visit(storage);
  assert.deepEqual(store.read().closing, [session]);
  assert.deepEqual(store.read().favourites, []);
  assert.equal(await guide.sweep(), true);
  await assert.rejects(client.resume(session, 1).step(Array(29).fill(0)), UnknownSession);
});

test("no place comes twice, no closed one, no favourite", async () => {
  const { visitor } = visit(new Storage());
  const ids = [];
  for (let count = 0; count < 12; count++) {
    ids.push((await visitor.next()).id);
    if (count % 3) visitor.dismiss();
    else visitor.love();
  }
  assert.equal(new Set(ids).size, ids.length);
});

test("a tab that was overtaken by another tab goes on in a new session", async () => {
  const storage = new Storage();
  const { visitor, client, store } = visit(storage);
  const { session } = await visitor.next();
  const { seq, obs } = store.read().seats[0];
  await client.resume(session, seq).step(obs, { reward: 0, terminated: true });
  await client.resume(session, seq + 1).step(obs);
  await client.resume(session, seq + 2).step(obs, { reward: 0, terminated: true });
  visitor.love();
  await visitor.settle();
  assert.ok((await visitor.next()).session);
});
