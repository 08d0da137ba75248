// What the page tells the agent is what the agent is told to expect: the vectors are those of the Python side.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

import { allowed, BOX, encode, TYPES } from "../js/contract.js";

const read = (path) => JSON.parse(readFileSync(new URL(path, import.meta.url), "utf8"));
const vectors = read("../../../tests/bored/vectors.json");
const places = read("../places.json");

for (const { name, now, here, before, type_before: typeBefore, favourites, observation } of vectors.observations) {
  test(`observation: ${name}`, () => {
    const seen = encode({ now: new Date(now), here, before, typeBefore, favourites });
    assert.equal(seen.length, observation.length);
    seen.forEach((number, index) => assert.ok(Math.abs(number - observation[index]) < 1e-5, `number ${index}`));
  });
}

for (const { name, now, shown, favourites, mask } of vectors.masks) {
  test(`mask: ${name}`, () => {
    const seen = new Map(Object.entries(shown).map(([index, at]) => [Number(index), Date.parse(at)]));
    assert.deepEqual(allowed(vectors.places, new Date(now), seen, favourites), mask);
  });
}

test("the vectors are some", () => {
  assert.ok(vectors.observations.length > 3 && vectors.masks.length > 3);
});

test("every place is in the box, of a known type, with an address and its street's Dutch name", () => {
  const [[south, west], [north, east]] = BOX;
  assert.deepEqual(places.types, TYPES);
  assert.deepEqual(places.box, { south, north, west, east });
  for (const { name, lat, lon, type, address, hours } of places.places) {
    assert.ok(lat >= south && lat <= north && lon >= west && lon <= east, name);
    assert.ok(TYPES.includes(type), name);
    assert.match(address, /, 1000 Bruxelles$/);
    assert.ok(places.streets[address.replace(/( \d+\w?)?, 1000 Bruxelles$/, "")], address);
    assert.ok(!hours || (hours.length === 7 && hours.flat().every(([opens, closes]) => opens < closes)), name);
  }
});

test("there are well over one hundred places, of every type, each with a name of its own", () => {
  const list = places.places;
  assert.ok(list.length >= 150);
  assert.equal(new Set(list.map(({ id }) => id)).size, list.length);
  for (const type of TYPES) assert.ok(list.filter((place) => place.type === type).length >= 15, type);
});
