// @ts-check
/** How far it is, and how long one walks. */

/** @typedef {import("./contract.js").Point} Point */

const METRES_PER_DEGREE = 111_320; // of latitude
export const DETOUR = 1.36; // of a walk against the straight line, measured on the streets of this centre
export const PACE = 80; // metres per minute

/**
 * Metres between two points, as the crow flies. Over the few kilometres of a city the earth is flat.
 * @param {Point} from
 * @param {Point} to
 */
export function metresBetween([lat, lon], [toLat, toLon]) {
  const north = (toLat - lat) * METRES_PER_DEGREE;
  const east = (toLon - lon) * METRES_PER_DEGREE * Math.cos(((lat + toLat) / 2) * (Math.PI / 180));
  return Math.hypot(north, east);
}

/**
 * A walk where nobody knows the streets.
 * @param {Point} from
 * @param {Point} to
 */
export function estimateWalk(from, to) {
  const metres = metresBetween(from, to) * DETOUR;
  return { metres, minutes: metres / PACE };
}
