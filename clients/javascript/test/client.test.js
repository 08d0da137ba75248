// What a client does where no Shepherd answers. Everything else is shown against a live server, in tests/clients.
import assert from "node:assert/strict";
import { once } from "node:events";
import { createServer } from "node:http";
import { test } from "node:test";

import * as shepherd from "../shepherd-client.js";

const { Client, ConnectionLost, ShepherdError, TransientError, UnexpectedReply } = shepherd;

/** The URL of a web server that is not Shepherd; it ends with the test. */
async function serve(t, answer) {
  const server = createServer(answer).listen(0, "127.0.0.1");
  await once(server, "listening");
  t.after(() => {
    server.closeAllConnections();
    server.close();
  });
  return `http://127.0.0.1:${server.address().port}`;
}

/** A URL where nothing listens. */
async function nowhere() {
  const server = createServer().listen(0, "127.0.0.1");
  await once(server, "listening");
  const { port } = server.address();
  server.close();
  return `http://127.0.0.1:${port}`;
}

test("it refuses a URL that is none", () => {
  assert.throws(() => new Client("sk_", { url: "127.0.0.1:8000 please" }), TypeError);
});

test("it gives up when its patience ends", async () => {
  const client = new Client("sk_", { url: await nowhere(), patience: 0.3 });
  const before = performance.now();
  await assert.rejects(client.session(), ConnectionLost);
  assert.ok(performance.now() - before > 100, "it has tried more than once");
});

test("it says that another web server is not Shepherd", async (t) => {
  const url = await serve(t, (_, response) => response.writeHead(404).end("<h1>Not found</h1>"));
  await assert.rejects(new Client("sk_", { url }).session(), (error) => {
    assert.ok(error instanceof UnexpectedReply);
    assert.equal(error.status, 404);
    assert.match(error.message, /is the URL right/);
    return true;
  });
});

test("it says so too when that server answers 200", async (t) => {
  const url = await serve(t, (_, response) => response.end("<h1>Welcome</h1>"));
  await assert.rejects(new Client("sk_", { url }).session(), UnexpectedReply);
});

test("a server that stays silent is a lost connection", async (t) => {
  const url = await serve(t, () => {});
  await assert.rejects(new Client("sk_", { url, patience: 0, timeout: 0.1 }).session(), ConnectionLost);
});

test("an AbortSignal ends a request that waits for its answer", async (t) => {
  const url = await serve(t, () => {});
  const signal = AbortSignal.timeout(100);
  await assert.rejects(new Client("sk_", { url }).session({ signal }), { name: "TimeoutError" });
});

test("an AbortSignal ends the pause between two attempts", async () => {
  const client = new Client("sk_", { url: await nowhere(), patience: 600 });
  const controller = new AbortController();
  setTimeout(() => controller.abort(), 300);
  await assert.rejects(client.session({ signal: controller.signal }), { name: "AbortError" });
});

test("every error is a ShepherdError with a code of its own", () => {
  const kinds = Object.values(shepherd).filter((kind) => kind.prototype instanceof ShepherdError && kind !== TransientError);
  const codes = kinds.map((kind) => new kind("").code);
  assert.equal(kinds.length, 19);
  assert.equal(new Set(codes).size, kinds.length);
  assert.ok(kinds.every((kind) => new kind("").name === kind.name));
});
