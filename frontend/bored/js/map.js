// @ts-check
/** The map: Leaflet with our drawing, the tiles of a map server above it where there is one, and what is shown on both. */

import { BOX } from "./contract.js";
import { draw } from "./drawing.js";
import { icon, pin } from "./icons.js";

/** @typedef {import("./contract.js").Point} Point */
/** @typedef {import("./places.js").Place} Place */
/** @typedef {{url: string, attribution: string}} Tiles */

const { L } = /** @type {{L: typeof import("leaflet")}} */ (/** @type {unknown} */ (globalThis));
const EQUATOR = 40_075_016; // metres around it
const TILE = 256; // pixels
const CENTRE = /** @type {Point[]} */ ([[50.8448, 4.3465], [50.8515, 4.3575]]); // what one sees first
const MARGIN = 0.004; // degrees around the box into which one may drag the map
const BAD_TILES = 3; // after which the map server is taken for unreachable
const NEAR = 17; // zoom
const STILL = matchMedia("(prefers-reduced-motion: reduce)");

export class CityMap {
  /** @type {import("leaflet").SVGOverlay | null} */
  #drawing = null;
  #resize = (/** @type {number} */ _metresPerPixel) => {};
  /** @type {import("leaflet").Marker | null} */
  #visitor = null;
  /** What is to be seen, however the map is resized. @type {Point[]} */
  #seen = CENTRE;

  /**
   * @param {HTMLElement} where
   * @param {Tiles | null} tiles
   * @param {string} attribution of the places
   */
  constructor(where, tiles, attribution) {
    const bounds = L.latLngBounds(BOX);
    this.map = L.map(where, {
      zoomControl: false, minZoom: 13, maxZoom: 19, zoomSnap: 0.25, maxBounds: bounds.pad(0.6), maxBoundsViscosity: 0.8,
    });
    this.map.attributionControl.setPrefix('<a href="https://leafletjs.com">Leaflet</a>').addAttribution(attribution);
    this.map.setView(bounds.getCenter(), 15);
    this.way = L.layerGroup().addTo(this.map);
    this.marks = L.layerGroup().addTo(this.map);
    this.map.on("zoomend", () => this.#scale());
    if (tiles) this.#addTiles(tiles);
    new ResizeObserver(() => this.#fill()).observe(where);
  }

  /**
   * @param {import("./drawing.js").MapData} data
   * @param {string} language
   */
  draw(data, language) {
    const { svg, resize } = draw(data, language);
    this.#drawing?.remove();
    this.#drawing = L.svgOverlay(svg, BOX, { pane: "tilePane", attribution: data.attribution }).addTo(this.map);
    this.#resize = resize;
    this.#scale();
  }

  /**
   * One place, in view together with the visitor.
   * @param {Place} place
   * @param {string} name
   * @param {Point} here
   */
  showPlace(place, name, here) {
    this.clear();
    const at = /** @type {Point} */ ([place.lat, place.lon]);
    L.marker(at, { icon: pinIcon(place.type, true), title: name, alt: name, keyboard: false }).addTo(this.marks);
    this.#look(isNear(here) ? [at, here] : [at]);
  }

  /**
   * Several places; one that is chosen is told.
   * @param {{place: Place, name: string}[]} places
   * @param {(place: Place) => void} chosen
   */
  showPlaces(places, chosen) {
    this.clear();
    for (const { place, name } of places) {
      const mark = L.marker([place.lat, place.lon], { icon: pinIcon(place.type, false), title: name, alt: name });
      mark.on("click", () => chosen(place)).addTo(this.marks);
    }
    if (places.length) this.#look(places.map(({ place }) => [place.lat, place.lon]));
  }

  /**
   * A circle for each place, instead of pins.
   * @param {{place: Place, told: string, radius: number, className: string}[]} circles radius in pixels
   */
  showCircles(circles) {
    this.clear();
    for (const { place, told, radius, className } of circles) {
      L.circleMarker([place.lat, place.lon], { radius, className }).bindTooltip(told).addTo(this.marks);
    }
  }

  /** @param {Place} place */
  focus(place) {
    this.#look([[place.lat, place.lon]]);
  }

  /** @param {import("./directions.js").Way} way */
  showWay({ line, estimated }) {
    this.hideWay();
    const smooth = { interactive: false, smoothFactor: 1 };
    L.polyline(line, { ...smooth, className: "way-edge" }).addTo(this.way);
    L.polyline(line, { ...smooth, className: estimated ? "way estimated" : "way" }).addTo(this.way);
    this.#look(line);
  }

  hideWay() {
    this.way.clearLayers();
  }

  /**
   * @param {Point} point
   * @param {boolean} located
   * @param {string} label
   */
  showVisitor(point, located, label) {
    this.#visitor?.remove();
    const mark = L.divIcon({ className: located ? "here" : "here assumed", iconSize: [22, 22] });
    this.#visitor = L.marker(point, { icon: mark, title: label, alt: label, keyboard: false, zIndexOffset: -500 });
    this.#visitor.addTo(this.map);
  }

  /** The whole city, and nothing in it. */
  showCity() {
    this.clear();
    this.#look(CENTRE);
  }

  clear() {
    this.hideWay();
    this.marks.clearLayers();
  }

  /** @param {Tiles} tiles */
  #addTiles({ url, attribution }) {
    let bad = 0;
    const layer = L.tileLayer(url, {
      attribution, maxZoom: 19, className: "tiles", referrerPolicy: "strict-origin-when-cross-origin", detectRetina: false,
    });
    layer.on("tileload", () => void (bad = -Infinity));
    layer.on("tileerror", () => void (++bad >= BAD_TILES && layer.remove())); // the drawing below is enough
    layer.setZIndex(2).addTo(this.map);
    globalThis.addEventListener("online", () => {
      bad = 0;
      layer.addTo(this.map);
    });
  }

  /** @param {Point[]} points */
  #look(points) {
    this.#seen = points;
    this.map.flyToBounds(L.latLngBounds(points), { ...this.#margins(), animate: !STILL.matches, duration: 0.6 });
  }

  #fill() {
    this.map.invalidateSize({ pan: false, animate: false });
    this.map.fitBounds(L.latLngBounds(this.#seen), { ...this.#margins(), animate: false });
  }

  #margins() {
    const { x, y } = this.map.getSize();
    const side = Math.min(56, x / 7);
    return {
      paddingTopLeft: L.point(side, Math.min(110, y / 3)), // a pin stands above its place
      paddingBottomRight: L.point(side, Math.min(48, y / 6)),
      maxZoom: NEAR,
    };
  }

  #scale() {
    const around = EQUATOR * Math.cos((this.map.getCenter().lat * Math.PI) / 180);
    this.#resize(around / (TILE * 2 ** this.map.getZoom()));
  }
}

/**
 * Whether somebody there would see the city on the same map.
 * @param {Point} point
 */
function isNear([lat, lon]) {
  const [[south, west], [north, east]] = BOX;
  return lat > south - MARGIN && lat < north + MARGIN && lon > west - MARGIN && lon < east + MARGIN;
}

/**
 * @param {string} type
 * @param {boolean} large
 */
function pinIcon(type, large) {
  const [width, height] = large ? [44, 56] : [32, 41];
  const html = pin();
  html.append(icon(type));
  return L.divIcon({
    html, className: `pin ${type}${large ? " large" : ""}`, iconSize: [width, height], iconAnchor: [width / 2, height - 2],
  });
}
