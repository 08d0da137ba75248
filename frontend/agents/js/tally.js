// @ts-check
/** Sums over what is counted of the actions. */

/** @typedef {[action: number, hour: number, count: number, total: number]} Row */
/** @typedef {{count: number, total: number}} Sum of episodes, and of their rewards */

/**
 * The sums of the rows that belong together.
 * @template K
 * @param {readonly Row[]} rows
 * @param {(row: Row) => K} key
 * @returns {Map<K, Sum>}
 */
export function sums(rows, key) {
  const found = new Map();
  for (const row of rows) {
    const sum = found.get(key(row)) ?? { count: 0, total: 0 };
    found.set(key(row), { count: sum.count + row[2], total: sum.total + row[3] });
  }
  return found;
}

/** The mean reward: the share that was loved, where rewards are 0 and 1. @param {Sum} sum */
export function mean({ count, total }) {
  return count ? total / count : 0;
}

/**
 * The keys with the largest counts, the largest first.
 * @template K
 * @param {Map<K, Sum>} found
 * @param {number} most
 * @returns {[K, Sum][]}
 */
export function largest(found, most) {
  return [...found].sort(([, a], [, b]) => b.count - a.count).slice(0, most);
}

/**
 * Which of `levels` steps a mean is on, between the lowest and the highest one; 0 where all are the same.
 * @param {number} value
 * @param {number} low
 * @param {number} high
 * @param {number} levels
 */
export function level(value, low, high, levels) {
  if (high <= low) return 0;
  return Math.min(levels - 1, Math.max(0, Math.floor(((value - low) / (high - low)) * levels)));
}
