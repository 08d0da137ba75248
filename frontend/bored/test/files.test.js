// The service worker keeps every file that the page needs, and what was copied here is what it was copied from.
import assert from "node:assert/strict";
import { existsSync, readdirSync, readFileSync } from "node:fs";
import { test } from "node:test";

const home = new URL("../", import.meta.url);
const read = (path) => readFileSync(new URL(path, home), "utf8");

test("the service worker keeps every module, style sheet and language", () => {
  const kept = new Set([...read("sw.js").matchAll(/"([\w./-]+\.(?:js|css|json|svg|webmanifest))"/g)].map(([, file]) => file));
  const needed = ["js", "css", "lang"].flatMap((folder) =>
    readdirSync(new URL(folder, home), { recursive: true }).map((file) => `${folder}/${file}`),
  );
  assert.deepEqual(needed.filter((file) => /\.\w+$/.test(file) && !kept.has(file)), []);
  assert.deepEqual([...kept].filter((file) => file !== "config.json" && !existsSync(new URL(file, home))), []);
});

test("Shepherd's client is the one of clients/javascript", () => {
  for (const name of ["shepherd-client.js", "shepherd-client.d.ts"]) {
    assert.equal(read(`vendor/${name}`), read(`../../clients/javascript/${name}`), `${name}: npm run vendor`);
  }
});

test("Leaflet came with its licence", () => {
  assert.match(read("vendor/leaflet/LICENSE"), /Redistributions in binary form/);
  assert.match(read("vendor/leaflet/leaflet.js"), /Leaflet 1\.9\.4/);
});

test("the installed page has its icons", () => {
  const { icons } = JSON.parse(read("manifest.webmanifest"));
  for (const { src } of icons) assert.ok(existsSync(new URL(src, home)), src);
});
