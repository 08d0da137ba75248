// @ts-check
/** How often each action was chosen and how it was rewarded: by hour; for the places of Bored in the city by kind and on the map. */

import { ask } from "/static/agents_app/live/ask.js";
import { number, part, say } from "/static/agents_app/live/dom.js";
import { showBars, showHours } from "./bars.js";
import { largest, sums } from "./tally.js";

/** @typedef {import("./tally.js").Row} Row */
/** @typedef {import("./city.js").City} City */

const MOST = 12; // actions that are listed
const NOTHING = "Nothing is counted in this run yet. The first episode of one step will be.";

export class Actions {
  /** @type {Row[]} */
  #rows = [];
  #version = -1;

  /**
   * @param {HTMLElement} root
   * @param {string} run
   * @param {City | null} city what the actions are called, if they are places
   */
  constructor(root, run, city) {
    this.root = root;
    this.run = run;
    this.city = city;
    this.kind = /** @type {HTMLSelectElement | null} */ (part(root, "kind"));
    for (const [kind, name] of city?.kinds ?? []) this.kind?.append(new Option(name, kind));
    this.kind?.addEventListener("change", () => this.#showHours());
  }

  /**
   * Null, if they are not counted.
   * @param {HTMLElement} root
   * @param {string} run
   */
  static async of(root, run) {
    const section = part(root, "actions");
    if (!section) return null;
    const city = section.dataset.places ? await (await import("./city.js")).City.load(part(root, "city")) : null;
    return new Actions(root, run, city);
  }

  /** Ask for what is new, and show it. Fails when the server does not answer. */
  async update() {
    const answer = await ask(this.root.dataset.actions ?? "", { run: this.run, version: this.#version });
    if (answer.unchanged) return;
    [this.#rows, this.#version] = [answer.rows, answer.version];
    this.#show();
  }

  #show() {
    const { root, city } = this, some = this.#rows.length > 0;
    part(root, "charts").hidden = !some;
    say(part(root, "no-actions"), some ? "" : NOTHING);
    say(part(root, "counted"), some ? `${number(this.#version)} ${city ? "suggestions answered" : "episodes"}` : "");
    const actions = sums(this.#rows, ([action]) => action);
    const most = largest(actions, MOST).map(([action, sum]) => /** @type {[string, any]} */ ([this.#name(action), sum]));
    showBars(/** @type {HTMLTableElement} */ (part(root, "most")), most, this.#words);
    this.#showHours();
    if (city) this.#showPlaces(city, actions);
  }

  #showHours() {
    const kind = this.kind?.value;
    const rows = kind ? this.#rows.filter(([action]) => this.city?.kindOf(action) === kind) : this.#rows;
    say(part(this.root, "peak"), showHours(part(this.root, "hours"), sums(rows, ([, hour]) => hour), this.#words));
  }

  /**
   * @param {City} city
   * @param {Map<number, import("./tally.js").Sum>} actions
   */
  #showPlaces(city, actions) {
    const kinds = sums(this.#rows, ([action]) => city.kindOf(action));
    const named = city.kinds.filter(([kind]) => kinds.has(kind)).map(([kind, name]) => /** @type {[string, any]} */ ([name, kinds.get(kind)]));
    showBars(/** @type {HTMLTableElement} */ (part(this.root, "kinds")), named, this.#words);
    city.show(actions);
  }

  /** @param {number} action */
  #name(action) {
    return this.city?.nameOf(action) ?? `Action ${action}`;
  }

  /** @param {number} value a mean reward */
  #words = (value) => (this.city ? `${Math.round(100 * value)} %` : number(value, 2));
}
