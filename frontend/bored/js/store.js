// @ts-check
/** What this phone remembers: one object in the browser's own storage, read anew each time, since tabs share it. */

/** @typedef {import("./contract.js").Point} Point */

/**
 * A session with the agent, and the one decision that may be open in it.
 * @typedef {object} Seat
 * @property {string} key of the session
 * @property {number} seq of its last answered step
 * @property {number[] | null} obs what the agent saw when it decided; null: no decision is open
 * @property {0 | 1 | null} answer of the visitor: loved or not; null: none yet
 */

/**
 * A place that was suggested.
 * @typedef {object} Suggestion
 * @property {string} id of the place
 * @property {string | null} session key of the seat that decided; null: chance decided, as the agent could not be reached
 * @property {"loved" | "dismissed" | null} verdict
 * @property {Reason} reason
 */

/**
 * What was known when it was suggested.
 * @typedef {object} Reason
 * @property {number} at ms since 1970
 * @property {Point} here
 * @property {number} share of its type among the favourites, 0 to 1
 * @property {boolean} located whether `here` is where the visitor really was
 */

/**
 * @typedef {object} Memory
 * @property {Seat[]} seats
 * @property {string[]} closing keys of sessions that are still to be closed at the server
 * @property {Suggestion | null} current what is shown
 * @property {Suggestion | null} waiting what comes next, since `current` was taken back
 * @property {string[]} favourites ids, newest first
 * @property {Record<string, number>} shown when each place was last suggested, by its id; ms since 1970
 * @property {Point | null} before where the visitor was at the last suggestion
 * @property {string | null} typeBefore type of the place suggested last
 * @property {boolean} locate whether the visitor lets us ask where they are
 * @property {string | null} language
 */

const NAME = "bored-in-the-city";
/** @type {Memory} */
const NOTHING = {
  seats: [], closing: [], current: null, waiting: null, favourites: [], shown: {}, before: null, typeBefore: null,
  locate: false, language: null,
};

export class Store {
  /** @type {string | null} */
  #kept = null; // where the browser lets nobody store anything, for as long as the page lives

  /** @param {Pick<Storage, "getItem" | "setItem" | "removeItem"> | null} storage */
  constructor(storage) {
    this.storage = storage;
  }

  /** @returns {Memory} */
  read() {
    try {
      const text = this.#kept ?? this.storage?.getItem(NAME);
      return { ...structuredClone(NOTHING), ...(text ? JSON.parse(text) : {}) };
    } catch {
      return structuredClone(NOTHING); // damaged, or forbidden
    }
  }

  /**
   * Change what is remembered, by a function that is given the object to change.
   * @template T
   * @param {(memory: Memory) => T} change
   * @returns {T} what the function returns
   */
  change(change) {
    const memory = this.read();
    const result = change(memory);
    this.#write(JSON.stringify(memory));
    return result;
  }

  /** Forget everything. */
  clear() {
    this.#kept = null;
    try {
      this.storage?.removeItem(NAME);
    } catch {
      // nothing could be kept there either
    }
  }

  /** @param {string} text */
  #write(text) {
    try {
      if (!this.storage) throw new Error("no storage");
      this.storage.setItem(NAME, text);
      this.#kept = null;
    } catch {
      this.#kept = text;
    }
  }
}

/** The browser's storage; null where it is forbidden. */
export function browserStorage() {
  try {
    return globalThis.localStorage ?? null;
  } catch {
    return null;
  }
}
