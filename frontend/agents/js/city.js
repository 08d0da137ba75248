// @ts-check
/** The places of Bored in the city: what they are called, and their map. Both are that page's own. */

import { CityMap } from "../../bored/js/map.js";
import { Places } from "../../bored/js/places.js";
import { Texts } from "../../bored/js/texts.js";
import { level, mean } from "./tally.js";

/** @typedef {import("./tally.js").Sum} Sum */

const HOME = "/bored/", LANGUAGE = "en";
const { L } = /** @type {{L: typeof import("leaflet")}} */ (/** @type {unknown} */ (globalThis));
const LEVELS = 5; // of colour
const SMALLEST = 4, LARGEST = 17; // radii, pixels
const TOUCH = matchMedia("(pointer: coarse)"); // there, one finger scrolls the page, and two move the map

export class City {
  /** Made once it is seen: a map that is hidden has no size to fit the city into. @type {CityMap | null} */
  #map = null;

  /**
   * @param {Places} places
   * @param {Texts} texts
   * @param {() => CityMap} makeMap
   */
  constructor(places, texts, makeMap) {
    this.places = places;
    this.texts = texts;
    this.makeMap = makeMap;
    this.kinds = /** @type {[kind: string, name: string][]} */ (
      [...new Set(places.list.map(({ type }) => type))].map((type) => [type, texts.say(`type.${type}`)])
    );
  }

  /** @param {HTMLElement} where */
  static async load(where) {
    const json = async (/** @type {string} */ file) => (await fetch(HOME + file)).json();
    const [places, sentences, config] = await Promise.all([Places.load(`${HOME}places.json`), json(`lang/${LANGUAGE}.json`), json("config.json")]);
    const drawing = await json(config.map);
    return new City(places, new Texts(LANGUAGE, sentences), () => mapOf(where, places.attribution, drawing));
  }

  /** @param {number} action */
  nameOf(action) {
    const place = this.places.list[action];
    return place && this.places.name(place, LANGUAGE);
  }

  /** @param {number} action */
  kindOf(action) {
    return this.places.list[action]?.type ?? "";
  }

  /** Large where much was suggested, and in the colour of the share that was loved. @param {Map<number, Sum>} actions */
  show(actions) {
    const all = [...actions].filter(([action]) => this.places.list[action]);
    const most = Math.max(...all.map(([, { count }]) => count)), best = Math.max(...all.map(([, sum]) => mean(sum)));
    const circles = all.map(([action, sum]) => ({
      place: this.places.list[action],
      told: `${this.nameOf(action)}: ${Math.round(100 * mean(sum))} % of ${sum.count} loved`,
      radius: SMALLEST + (LARGEST - SMALLEST) * Math.sqrt(sum.count / most),
      className: `share share-${level(mean(sum), 0, best, LEVELS)}`,
    }));
    this.#map ??= this.makeMap();
    this.#map.showCircles(circles.sort((a, b) => b.radius - a.radius)); // small ones above
  }
}

/**
 * @param {HTMLElement} where
 * @param {string} attribution
 * @param {import("../../bored/js/drawing.js").MapData} drawing
 */
function mapOf(where, attribution, drawing) {
  const map = new CityMap(where, null, attribution);
  map.draw(drawing, LANGUAGE);
  map.map.scrollWheelZoom.disable();
  if (TOUCH.matches) map.map.dragging.disable();
  L.control.zoom({ position: "topright" }).addTo(map.map);
  return map;
}
