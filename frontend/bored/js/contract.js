// @ts-check
/**
 * What page and agent agree on (docs/bored.md): what the agent observes, and which places may be suggested.
 * clients/environments/shepherd_environments/bored.py says the same in Python; tests/bored/vectors.json holds both to it.
 */

import { isOpen, localTime } from "./hours.js";

/** @typedef {[lat: number, lon: number]} Point degrees (WGS 84) */
/** @typedef {import("./hours.js").Hours} Hours */

/**
 * What is known of a visitor when a place is to be suggested.
 * @typedef {object} Visit
 * @property {Date} now
 * @property {Point} here
 * @property {Point | null} before where they were at the suggestion before
 * @property {string | null} typeBefore type of the place suggested before
 * @property {Record<string, number>} favourites how many, by type
 */

export const TYPES = ["restaurant", "asian_restaurant", "shop", "thriftshop", "cafe", "bar", "sightseeing"];
export const BOX = /** @type {[Point, Point]} */ ([[50.84, 4.338], [50.857, 4.366]]); // south-west, north-east corner
export const GRAND_PLACE = /** @type {Point} */ ([50.8467, 4.3525]); // where a visitor is whose position nobody knows
const DAY_BEGINS = [6, 12, 18, 23]; // hours at which morning, afternoon, evening and night begin
const LATELY = 7 * 24 * 60 * 60 * 1000; // ms
const FEWEST = 10; // places to choose from, while there are so many that may come back

/**
 * The observation: 29 numbers, each from -1 to 1.
 * @param {Visit} visit
 * @returns {number[]}
 */
export function encode({ now, here, before, typeBefore, favourites }) {
  const { hour, weekday } = localTime(now);
  return [
    ...inBox(here),
    ...inBox(before ?? here),
    ...TYPES.map((type) => Number(type === typeBefore)),
    ...shares(favourites),
    ...oneHot(timeOfDay(hour), DAY_BEGINS.length),
    ...oneHot(weekday, 7),
  ];
}

/**
 * Which places may be suggested now: none that is closed, a favourite, or was shown within LATELY. Where fewer than FEWEST
 * remain, what was shown longest ago comes back; where none remains, all are allowed.
 * @param {readonly {hours?: Hours | null}[]} places
 * @param {Date} now
 * @param {ReadonlyMap<number, number>} shown when each was last suggested to this visitor, by its number; ms since 1970
 * @param {readonly number[]} favourites numbers
 * @returns {boolean[]}
 */
export function allowed(places, now, shown, favourites) {
  const offered = places.map((place, index) => isOpen(place.hours, now) && !favourites.includes(index));
  const lately = [...shown].filter(([index, at]) => offered[index] && now.getTime() - at < LATELY);
  const mask = [...offered];
  for (const [index] of lately) mask[index] = false;
  const missing = Math.max(0, FEWEST - mask.filter(Boolean).length);
  const longestAgo = lately.sort(([a, first], [b, second]) => first - second || a - b);
  for (const [index] of longestAgo.slice(0, missing)) mask[index] = true;
  return mask.some(Boolean) ? mask : places.map(() => true);
}

/**
 * 0 morning, 1 afternoon, 2 evening, 3 night, which lasts until the morning.
 * @param {number} hour
 */
export function timeOfDay(hour) {
  const begun = DAY_BEGINS.filter((begins) => hour >= begins).length;
  return (begun + DAY_BEGINS.length - 1) % DAY_BEGINS.length;
}

/**
 * Each type's share of all favourites; all 0 without favourites.
 * @param {Record<string, number>} favourites how many, by type
 */
export function shares(favourites) {
  const total = Object.values(favourites).reduce((sum, count) => sum + count, 0);
  return TYPES.map((type) => (total ? (favourites[type] ?? 0) / total : 0));
}

/**
 * Latitude and longitude from -1 to 1 across the box; whoever is outside is at its edge.
 * @param {Point} point
 */
function inBox(point) {
  const [low, high] = BOX;
  return point.map((value, axis) => {
    const across = (value - low[axis]) / (high[axis] - low[axis]);
    return Math.min(1, Math.max(-1, 2 * across - 1));
  });
}

/**
 * @param {number} index
 * @param {number} length
 */
function oneHot(index, length) {
  return Array.from({ length }, (_, place) => Number(place === index));
}
