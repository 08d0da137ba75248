// @ts-check
/** The way on foot, by an open routing service where one can be reached, else as the crow flies. */

import { estimateWalk } from "./distance.js";

/** @typedef {import("./contract.js").Point} Point */

/**
 * @typedef {object} Way
 * @property {Point[]} line
 * @property {number} metres
 * @property {number} minutes
 * @property {boolean} estimated a straight line, as nobody was there who knows the streets
 */

const PATIENCE = 4000; // ms
const KEPT = 100; // metres; a service that leads elsewhere than to the place has misunderstood

/**
 * @param {Point} from
 * @param {Point} to
 * @param {string | null} service address of a server that speaks as OSRM does; null: there is none
 * @returns {Promise<Way>}
 */
export async function findWay(from, to, service) {
  const estimate = { line: [from, to], ...estimateWalk(from, to), estimated: true };
  if (!service) return estimate;
  try {
    return await askService(from, to, service);
  } catch {
    return estimate; // offline, busy, or it knows no way
  }
}

/**
 * @param {Point} from
 * @param {Point} to
 * @param {string} service
 * @returns {Promise<Way>}
 */
async function askService(from, to, service) {
  const ends = [from, to].map(([lat, lon]) => `${lon},${lat}`).join(";");
  const url = `${service}/route/v1/foot/${ends}?overview=full&geometries=geojson`;
  const reply = await fetch(url, { signal: AbortSignal.timeout(PATIENCE), referrerPolicy: "no-referrer" });
  const [route] = (await reply.json()).routes;
  const line = route.geometry.coordinates.map((/** @type {[number, number]} */ [lon, lat]) => [lat, lon]);
  if (!line.length || estimateWalk(line.at(-1), to).metres > KEPT) throw new Error("the way ends elsewhere");
  return { line: [from, ...line, to], metres: route.distance, minutes: route.duration / 60, estimated: false };
}

/**
 * Where a map of the visitor's own device, or of the web, shows the way.
 * @param {Point} from
 * @param {Point} to
 * @param {string} name
 * @param {string} userAgent
 */
export function ownMap(from, [lat, lon], name, userAgent) {
  if (/android/i.test(userAgent)) return `geo:${lat},${lon}?q=${lat},${lon}(${encodeURIComponent(name)})`;
  if (/iphone|ipad|ipod/i.test(userAgent)) return `https://maps.apple.com/?daddr=${lat},${lon}&dirflg=w`;
  const route = encodeURIComponent(`${from.join(",")};${lat},${lon}`);
  return `https://www.openstreetmap.org/directions?engine=fossgis_osrm_foot&route=${route}`;
}

/**
 * The place in OpenStreetMap.
 * @param {Point} point
 */
export function openStreetMap([lat, lon]) {
  return `https://www.openstreetmap.org/?mlat=${lat}&mlon=${lon}#map=19/${lat}/${lon}`;
}
