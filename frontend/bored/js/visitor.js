// @ts-check
/** What a visitor does: ask for a place, love it, dismiss it, take that back. Without a word about how it looks. */

import { allowed, encode, shares, TYPES } from "./contract.js";
import { metresBetween } from "./distance.js";
import { pointOf } from "./places.js";
import { ShepherdError } from "../vendor/shepherd-client.js";

/** @typedef {import("./store.js").Suggestion} Suggestion */
/** @typedef {import("./contract.js").Point} Point */

const STROLL = 400; // metres; where chance decides, a place so far away is e times less likely than one next door

export class Visitor {
  /** @type {Suggestion | null} */
  #retractable = null; // whose answer is held back, so that it can be taken back

  /**
   * @param {object} world
   * @param {import("./places.js").Places} world.places
   * @param {import("./store.js").Store} world.store
   * @param {import("./whereabouts.js").Whereabouts} world.whereabouts
   * @param {import("./guide.js").Guide | null} world.guide null: there is no agent to ask
   * @param {() => Date} [world.clock]
   * @param {() => number} [world.random]
   */
  constructor({ places, store, whereabouts, guide, clock = () => new Date(), random = Math.random }) {
    this.places = places;
    this.store = store;
    this.whereabouts = whereabouts;
    this.guide = guide;
    this.clock = clock;
    this.random = random;
  }

  /** What is suggested now. */
  get current() {
    const { current } = this.store.read();
    return current && this.places.get(current.id) ? current : null;
  }

  /** The favourites, newest first. */
  get favourites() {
    return this.store.read().favourites.flatMap((id) => this.places.get(id) ?? []);
  }

  /** @returns {Promise<Suggestion>} */
  async next() {
    if (this.#retractable?.verdict === "loved") this.#hold(null);
    const waiting = this.#takeWaiting();
    if (waiting) return waiting;
    const now = this.clock();
    const { point: here, located } = this.whereabouts.get();
    const { mask, obs, counts } = this.#look(now, here);
    const { number, session } = await this.#choose(obs, mask, here);
    const { id, type } = this.places.list[number];
    const share = shares(counts)[TYPES.indexOf(type)];
    /** @type {Suggestion} */
    const suggestion = { id, session, verdict: null, reason: { at: now.getTime(), here, share, located } };
    this.store.change((memory) => {
      memory.current = suggestion;
      memory.shown[id] = now.getTime();
      memory.before = here;
      memory.typeBefore = type;
    });
    return suggestion;
  }

  /** "I love it": one of the favourites from now on. */
  love() {
    this.#decide("loved");
  }

  /** "Not for me". */
  dismiss() {
    this.#decide("dismissed");
  }

  /** Take the last decision back, while its answer is held back. Returns whether there was one. */
  undo() {
    const suggestion = this.#retractable;
    if (!suggestion) return false;
    this.#hold(null);
    this.guide?.answer(suggestion.session, null);
    this.store.change((memory) => {
      if (memory.current && memory.current.id !== suggestion.id) memory.waiting = memory.current;
      memory.current = { ...suggestion, verdict: null };
      memory.favourites = memory.favourites.filter((id) => id !== suggestion.id);
    });
    return true;
  }

  /** From now on the last decision cannot be taken back: send what waits. Returns whether all has arrived. */
  async settle() {
    this.#hold(null);
    return (await this.guide?.settle()) ?? true;
  }

  /**
   * Keep a place among the favourites, or no longer. The agent learns of suggestions only.
   * @param {string} id
   * @param {boolean} keep
   */
  keep(id, keep) {
    this.store.change((memory) => {
      memory.favourites = memory.favourites.filter((other) => other !== id);
      if (keep) memory.favourites.unshift(id);
    });
  }

  /** Delete all that is known of this visitor, here and at the server. Returns whether the server could be told. */
  async forget() {
    this.#hold(null);
    this.whereabouts.stop();
    const told = (await this.guide?.leave()) ?? true;
    const { closing } = this.store.read();
    this.store.clear();
    if (closing.length) this.store.change((memory) => void (memory.closing = closing));
    return told;
  }

  /** @param {"loved" | "dismissed"} verdict */
  #decide(verdict) {
    const { current } = this;
    if (!current || current.verdict) return;
    const decided = { ...current, verdict };
    this.store.change((memory) => void (memory.current = decided));
    if (verdict === "loved") this.keep(current.id, true);
    this.#hold(decided);
    this.guide?.answer(current.session, verdict === "loved" ? 1 : 0);
  }

  /** @param {Suggestion | null} decided whose answer is not sent yet */
  #hold(decided) {
    this.#retractable = decided;
    if (this.guide) this.guide.held = decided?.session ?? null;
  }

  #takeWaiting() {
    return this.store.change((memory) => {
      const { waiting } = memory;
      memory.waiting = null;
      if (waiting) memory.current = waiting;
      return waiting;
    });
  }

  /**
   * What the agent is shown.
   * @param {Date} now
   * @param {Point} here
   */
  #look(now, here) {
    const { before, typeBefore, shown } = this.store.read();
    const { numbers } = this.places;
    /** @type {Record<string, number>} */
    const counts = {};
    for (const { type } of this.favourites) counts[type] = (counts[type] ?? 0) + 1;
    const seen = new Map(Object.entries(shown).flatMap(([id, at]) => (numbers.has(id) ? [[numbers.get(id), at]] : [])));
    const kept = this.favourites.map(({ id }) => numbers.get(id));
    return {
      counts,
      obs: encode({ now, here, before, typeBefore, favourites: counts }),
      mask: allowed(this.places.list, now, /** @type {any} */ (seen), /** @type {number[]} */ (kept)),
    };
  }

  /**
   * By the agent; by chance where it cannot be asked.
   * @param {number[]} obs
   * @param {boolean[]} mask
   * @param {Point} here
   * @returns {Promise<{number: number, session: string | null}>}
   */
  async #choose(obs, mask, here) {
    try {
      const decision = await this.guide?.suggest(obs, mask);
      if (decision && this.places.list[decision.action]) return { number: decision.action, session: decision.session };
    } catch (error) {
      if (!(error instanceof ShepherdError)) throw error;
      console.info(`The agent cannot be asked, so chance decides. ${error.message}`);
    }
    return { number: this.#draw(mask, here), session: null };
  }

  /**
   * By chance, rather near than far.
   * @param {boolean[]} mask
   * @param {Point} here
   */
  #draw(mask, here) {
    const metres = this.places.list.map((place) => metresBetween(here, pointOf(place)));
    const nearest = Math.min(...metres.filter((_, number) => mask[number])); // so that far away from all, all goes on
    const weights = metres.map((far, number) => (mask[number] ? Math.exp((nearest - far) / STROLL) : 0));
    let left = this.random() * weights.reduce((sum, weight) => sum + weight, 0);
    const number = weights.findIndex((weight) => (left -= weight) < 0);
    return number >= 0 ? number : mask.indexOf(true);
  }
}
