// @ts-check
/** Where the visitor is. They may say no: then their last favourite stands for it, or the Grand Place. */

import { GRAND_PLACE } from "./contract.js";
import { pointOf } from "./places.js";

/** @typedef {import("./contract.js").Point} Point */

const WATCHING = { enableHighAccuracy: true, maximumAge: 30_000, timeout: 15_000 };
const DECIMALS = 4; // of a degree: about ten metres, which is all that anybody needs to know

export class Whereabouts {
  /** @type {Point | null} */
  #seen = null;
  /** @type {number | null} */
  #watch = null;

  /**
   * @param {Pick<Geolocation, "watchPosition" | "clearWatch"> | undefined} geolocation of the browser
   * @param {import("./store.js").Store} store
   * @param {import("./places.js").Places} places
   */
  constructor(geolocation, store, places) {
    this.geolocation = geolocation;
    this.store = store;
    this.places = places;
    /** Called whenever the visitor has moved. */
    this.onMove = () => {};
  }

  /** Where the visitor is, and whether that is known or assumed. */
  get() {
    if (this.#seen) return { point: this.#seen, located: true };
    const last = this.places.get(this.store.read().favourites[0] ?? "");
    return { point: last ? pointOf(last) : GRAND_PLACE, located: false };
  }

  /**
   * Ask the browser, which asks the visitor, and go on following. Returns whether a position came.
   * @returns {Promise<boolean>}
   */
  start() {
    this.stop();
    const { geolocation } = this;
    if (!geolocation) return Promise.resolve(false);
    return new Promise((resolve) => {
      const moved = (/** @type {GeolocationPosition} */ { coords }) => {
        this.#seen = [rounded(coords.latitude), rounded(coords.longitude)];
        this.#remember(true);
        this.onMove();
        resolve(true);
      };
      const failed = (/** @type {GeolocationPositionError} */ { code, PERMISSION_DENIED }) => {
        if (code === PERMISSION_DENIED) this.stop();
        resolve(false);
      };
      this.#watch = geolocation.watchPosition(moved, failed, WATCHING);
    });
  }

  /** Follow no longer, and forget where they were. */
  stop() {
    if (this.#watch !== null) this.geolocation?.clearWatch(this.#watch);
    this.#watch = this.#seen = null;
    this.#remember(false);
  }

  /** @param {boolean} locate */
  #remember(locate) {
    this.store.change((memory) => {
      memory.locate = locate;
    });
  }
}

/** @param {number} degrees */
function rounded(degrees) {
  return Number(degrees.toFixed(DECIMALS));
}
