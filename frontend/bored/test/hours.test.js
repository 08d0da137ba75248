import assert from "node:assert/strict";
import { test } from "node:test";

import { describe, isOpen, localTime } from "../js/hours.js";

const week = (spans) => Array.from({ length: 7 }, () => spans);
const at = (text) => new Date(text); // in winter Brussels is one hour ahead of UTC

test("the clock is that of Brussels, in winter and in summer", () => {
  assert.deepEqual(localTime(at("2026-11-25T23:30:00Z")), { weekday: 3, hour: 0, minute: 30 });
  assert.deepEqual(localTime(at("2026-07-06T10:00:00Z")), { weekday: 0, hour: 12, minute: 0 });
});

test("what is not known is open", () => {
  assert.ok(isOpen(undefined, new Date()));
  assert.deepEqual(describe(undefined, new Date()), { state: "unknown" });
});

test("it opens to the minute and closes to the minute", () => {
  const hours = week([[600, 1080]]);
  for (const [time, open] of [["08:59", false], ["09:00", true], ["16:59", true], ["17:00", false]]) {
    assert.equal(isOpen(hours, at(`2026-11-25T${time}:00Z`)), open, time);
  }
});

test("the night belongs to the day before", () => {
  const hours = [...week([]).slice(0, 4), [[1080, 1560]], [], []]; // Friday 18:00 to 2:00
  assert.deepEqual(describe(hours, at("2026-11-28T00:30:00Z")), { state: "open", time: "02:00" });
  assert.deepEqual(describe(hours, at("2026-11-28T01:00:00Z")), { state: "closed" });
});

test("it says when it opens, when it closes, and that it always is", () => {
  const lunchAndDinner = week([[720, 870], [1140, 1440]]);
  assert.deepEqual(describe(lunchAndDinner, at("2026-11-25T12:00:00Z")), { state: "open", time: "14:30" });
  assert.deepEqual(describe(lunchAndDinner, at("2026-11-25T15:00:00Z")), { state: "opens", time: "19:00" });
  assert.deepEqual(describe(lunchAndDinner, at("2026-11-25T20:00:00Z")), { state: "open", time: "00:00" });
  assert.deepEqual(describe(week([[0, 1440]]), new Date()), { state: "always" });
});
