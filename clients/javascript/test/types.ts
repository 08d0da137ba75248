// Compiled, never run: a program in TypeScript against shepherd-client.d.ts. `@ts-expect-error` lines must be errors.
import { Client, InvalidObservation, type Reply, type Session } from "../shepherd-client.js";

export async function play(): Promise<number | null> {
  const session: Session = await new Client("sk_", { url: "http://127.0.0.1:8000", patience: 5 }).session();
  const action = await session.act<number>(new Float32Array(4), { signal: AbortSignal.timeout(1000) });
  const reply: Reply = await session.step({ camera: [[[0, 0, 0]]], speed: 1 }, { reward: action, actionMask: [true] });
  if (reply.action === null) return reply.episodeReturn;
  // @ts-expect-error: a text is no observation
  await session.step("forward");
  // @ts-expect-error: there is no such option
  await session.step([1, 2], { done: true });
  return session.observe([1, 2], 0.5, { truncated: true });
}

export function mend(error: unknown): string {
  return error instanceof InvalidObservation ? `${error.code} ${error.status}: ${error.message}` : "";
}
