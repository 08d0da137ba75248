// The sums that the page shows.
import assert from "node:assert/strict";
import { test } from "node:test";

import { largest, level, mean, sums } from "../js/tally.js";

const ROWS = [[3, 9, 4, 1], [3, 10, 2, 2], [0, 9, 10, 0], [7, 23, 1, -0.5]];

test("rows are summed by whatever is asked for", () => {
  assert.deepEqual([...sums(ROWS, ([action]) => action)], [
    [3, { count: 6, total: 3 }],
    [0, { count: 10, total: 0 }],
    [7, { count: 1, total: -0.5 }],
  ]);
  assert.deepEqual(sums(ROWS, ([, hour]) => hour).get(9), { count: 14, total: 1 });
  assert.equal(sums([], () => 0).size, 0);
});

test("the mean is the share that was loved, and nothing of nothing", () => {
  assert.equal(mean({ count: 6, total: 3 }), 0.5);
  assert.equal(mean({ count: 0, total: 0 }), 0);
});

test("what was chosen most comes first", () => {
  assert.deepEqual(largest(sums(ROWS, ([action]) => action), 2).map(([action]) => action), [0, 3]);
});

test("levels divide what lies between the lowest and the highest", () => {
  assert.deepEqual([0, 0.1, 0.21, 0.5, 0.99, 1, 2, -1].map((value) => level(value, 0, 1, 5)), [0, 0, 1, 2, 4, 4, 4, 0]);
  assert.equal(level(0.3, 0.3, 0.3, 5), 0);
});
