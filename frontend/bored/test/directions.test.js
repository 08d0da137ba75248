import assert from "node:assert/strict";
import { once } from "node:events";
import { createServer } from "node:http";
import { test } from "node:test";

import { findWay, ownMap } from "../js/directions.js";
import { estimateWalk, metresBetween } from "../js/distance.js";

const GRAND_PLACE = [50.8467, 4.3525];
const BOURSE = [50.8481, 4.3497];

/** A routing service that answers so; it ends with the test. */
async function service(t, answer) {
  const asked = [];
  const server = createServer((request, response) => {
    asked.push(request.url);
    response.end(JSON.stringify(answer));
  }).listen(0, "127.0.0.1");
  await once(server, "listening");
  t.after(() => {
    server.closeAllConnections();
    server.close();
  });
  return { url: `http://127.0.0.1:${server.address().port}`, asked };
}

const routeTo = ([lat, lon]) => ({
  routes: [{ distance: 310, duration: 240, geometry: { coordinates: [[4.3525, 50.8467], [4.351, 50.8475], [lon, lat]] } }],
});

test("distances are those of the earth", () => {
  assert.ok(Math.abs(metresBetween([50.84, 4.35], [50.85, 4.35]) - 1113) < 2);
  assert.ok(Math.abs(metresBetween([50.85, 4.34], [50.85, 4.35]) - 703) < 2);
});

test("without a service the way is a straight line, 1.36 times as long, at 80 metres a minute", async () => {
  const way = await findWay(GRAND_PLACE, BOURSE, null);
  assert.deepEqual(way.line, [GRAND_PLACE, BOURSE]);
  assert.ok(way.estimated);
  assert.ok(Math.abs(way.metres - 1.36 * metresBetween(GRAND_PLACE, BOURSE)) < 1e-9);
  assert.ok(Math.abs(way.minutes - way.metres / 80) < 1e-9);
});

test("a service leads along the streets", async (t) => {
  const { url, asked } = await service(t, routeTo(BOURSE));
  const way = await findWay(GRAND_PLACE, BOURSE, url);
  assert.deepEqual([way.metres, way.minutes, way.estimated], [310, 4, false]);
  assert.deepEqual(way.line[2], [50.8475, 4.351]);
  assert.match(asked[0], /^\/route\/v1\/foot\/4\.3525,50\.8467;4\.3497,50\.8481\?/);
});

test("a service that answers nonsense, leads elsewhere or cannot be reached is not believed", async (t) => {
  const wrong = [{ code: "NoRoute" }, { routes: [] }, routeTo([50.9, 4.4])];
  for (const answer of wrong) assert.ok((await findWay(GRAND_PLACE, BOURSE, (await service(t, answer)).url)).estimated);
  assert.ok((await findWay(GRAND_PLACE, BOURSE, "http://127.0.0.1:9")).estimated);
});

test("the device's own map is opened", () => {
  assert.match(ownMap(GRAND_PLACE, BOURSE, "La Bourse", "Linux; Android 16"), /^geo:50\.8481,4\.3497\?q=.*\(La%20Bourse\)$/);
  assert.match(ownMap(GRAND_PLACE, BOURSE, "La Bourse", "iPhone"), /^https:\/\/maps\.apple\.com\/\?daddr=50\.8481,4\.3497/);
  assert.match(ownMap(GRAND_PLACE, BOURSE, "La Bourse", "X11; Linux"), /openstreetmap\.org\/directions.*50\.8467%2C4\.3525%3B50/);
  assert.ok(estimateWalk(GRAND_PLACE, GRAND_PLACE).metres === 0);
});
