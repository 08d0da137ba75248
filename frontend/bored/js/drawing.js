// @ts-check
/**
 * A map as one SVG drawing, in metres: ours (sketch.json), or the streets that an operator has imported (map.json). It needs no
 * server of map tiles and takes its colours from the style sheet.
 */

import { BOX } from "./contract.js";
import { metresBetween } from "./distance.js";

/** @typedef {import("./contract.js").Point} Point */
/** @typedef {{fr?: string, nl?: string}} Named */
/** @typedef {Named & {kind: "main" | "street" | "foot", line: Point[]}} Street */
/** @typedef {Named & {kind: "park" | "water" | "square" | "building", ring: Point[]}} Area */
/** @typedef {Named & {at: Point}} Station */
/** @typedef {{attribution: string, streets: Street[], areas: Area[], stations: Station[]}} MapData */

const SVG = "http://www.w3.org/2000/svg";
const [SOUTH_WEST, NORTH_EAST] = BOX;
const NORTH_WEST = /** @type {Point} */ ([NORTH_EAST[0], SOUTH_WEST[1]]);
const WIDTH = metresBetween(NORTH_WEST, NORTH_EAST);
const HEIGHT = metresBetween(NORTH_WEST, SOUTH_WEST);
const LETTER = 6.4; // pixels that a letter of a street's name takes
const ORDER = /** @type {const} */ (["park", "water", "building", "square"]);
const STREETS = /** @type {const} */ (["foot", "street", "main"]);

/**
 * The drawing. `resize` adapts the names in it to the scale that is seen.
 * @param {MapData} data
 * @param {string} language
 */
export function draw(data, language) {
  const svg = element("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "drawing", "aria-hidden": "true" });
  svg.append(element("rect", { class: "land", width: WIDTH, height: HEIGHT }));
  for (const kind of ORDER) svg.append(path(kind, rings(data.areas, kind)));
  for (const kind of STREETS) svg.append(path(`${kind} edge`, lines(data.streets, kind)));
  for (const kind of STREETS) svg.append(path(kind, lines(data.streets, kind)));
  const names = [...streetNames(data.streets, language), ...areaNames(data.areas, language)];
  svg.append(...names.map(({ node }) => node), ...data.stations.map((station) => stationSign(station, language)));
  return { svg, resize: (/** @type {number} */ metresPerPixel) => resize(svg, names, metresPerPixel) };
}

/**
 * Names are as large on the screen at every scale; one that does not fit along its street is left out.
 * @param {SVGElement} svg
 * @param {{node: SVGElement, letters: number, metres: number}[]} names
 * @param {number} metresPerPixel
 */
function resize(svg, names, metresPerPixel) {
  svg.style.setProperty("--pixel", `${metresPerPixel}px`);
  for (const { node, letters, metres } of names) {
    node.classList.toggle("too-long", letters * LETTER * metresPerPixel > metres);
  }
}

/**
 * Along the longest piece of each street.
 * @param {Street[]} streets
 * @param {string} language
 */
function streetNames(streets, language) {
  /** @type {Map<string, Street>} */
  const longest = new Map();
  for (const street of streets) {
    const name = nameOf(street, language);
    const other = longest.get(name);
    if (name && (!other || length(street.line) > length(other.line))) longest.set(name, street);
  }
  return [...longest].map(([name, { kind, line }], number) => {
    const eastward = line[0][1] <= line[line.length - 1][1] ? line : [...line].reverse(); // so that nothing is upside down
    const id = `way-${number}`;
    const group = element("g", { class: `name ${kind}` });
    const text = element("text", {});
    const along = element("textPath", { href: `#${id}`, startOffset: "50%" });
    along.textContent = name;
    text.append(along);
    const metres = metresBetween(line[0], line[line.length - 1]); // not along it: no name goes around corners
    group.append(element("path", { id, d: polyline(eastward), class: "guide" }), text);
    return { node: group, letters: name.length, metres };
  });
}

/**
 * In the middle of squares, parks and waters.
 * @param {Area[]} areas
 * @param {string} language
 */
function areaNames(areas, language) {
  const named = areas.filter((area) => nameOf(area, language) && area.kind !== "building");
  return named.map((area) => {
    const points = area.ring.map(project);
    const [x, y] = [0, 1].map((axis) => points.reduce((sum, point) => sum + point[axis], 0) / points.length);
    const node = element("text", { x, y, class: `name ${area.kind}` });
    node.textContent = nameOf(area, language);
    const across = 2.2 * Math.max(...points.map((point) => Math.hypot(point[0] - x, point[1] - y)));
    return { node, letters: node.textContent.length, metres: across };
  });
}

/**
 * @param {Station} station
 * @param {string} language
 */
function stationSign(station, language) {
  const [x, y] = project(station.at);
  const group = element("g", { class: "station", transform: `translate(${x} ${y})` });
  const letter = element("text", { class: "letter" });
  letter.textContent = "M";
  const name = element("text", { class: "name" });
  name.textContent = nameOf(station, language);
  group.append(element("circle", {}), letter, name);
  return group;
}

/**
 * @param {Named} what
 * @param {string} language
 */
function nameOf({ fr = "", nl = "" }, language) {
  return (language === "nl" && nl) || fr || nl;
}

/**
 * @param {Area[]} areas
 * @param {string} kind
 */
function rings(areas, kind) {
  const chosen = areas.filter((area) => area.kind === kind);
  return chosen.map(({ ring }) => `${polyline(ring)}Z`).join("");
}

/**
 * @param {Street[]} streets
 * @param {string} kind
 */
function lines(streets, kind) {
  const chosen = streets.filter((street) => street.kind === kind);
  return chosen.map(({ line }) => polyline(line)).join("");
}

/** @param {Point[]} points */
function polyline(points) {
  return `M${points.map((point) => project(point).map((metres) => metres.toFixed(1)).join(" ")).join("L")}`;
}

/** @param {Point[]} line */
function length(line) {
  return line.slice(1).reduce((sum, point, before) => sum + metresBetween(line[before], point), 0);
}

/**
 * Metres to the east and to the south of the box's corner.
 * @param {Point} point
 */
function project([lat, lon]) {
  const [[south, west], [north, east]] = BOX;
  return [((lon - west) / (east - west)) * WIDTH, ((north - lat) / (north - south)) * HEIGHT];
}

/**
 * @param {string} kind
 * @param {string} d
 */
function path(kind, d) {
  return element("path", { class: kind, d });
}

/**
 * @param {string} name
 * @param {Record<string, string | number>} attributes
 */
function element(name, attributes) {
  const node = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, String(value));
  return node;
}
