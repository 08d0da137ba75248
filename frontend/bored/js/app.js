// @ts-check
/** The page: what its buttons do, and what is shown after that. Addresses: #, #favourites, #place/<id>, #privacy. */

import { button } from "./dom.js";
import { Snack } from "./snack.js";
import { chooseLanguage, Texts } from "./texts.js";
import { favouritesList } from "./views/favourites.js";
import { openMenu } from "./views/menu.js";
import { placeCard } from "./views/place.js";
import { privacyPage } from "./views/privacy.js";
import { suggestionCard, waiting, welcome } from "./views/suggestion.js";

/** @typedef {import("./places.js").Place} Place */
/** @typedef {Event & {prompt: () => Promise<unknown>}} Installer the browser's offer to install the page */

/** @param {string} id */
const byId = (id) => /** @type {HTMLElement} */ (document.getElementById(id));

export class App {
  /** @type {Installer | null} */
  installer = null;
  /** @type {Promise<unknown> | null} */
  #asking = null;

  /**
   * @param {object} parts
   * @param {import("./config.js").Config} parts.config
   * @param {import("./places.js").Places} parts.places
   * @param {import("./store.js").Store} parts.store
   * @param {import("./whereabouts.js").Whereabouts} parts.whereabouts
   * @param {import("./visitor.js").Visitor} parts.visitor
   * @param {import("./map.js").CityMap} parts.map
   * @param {import("./drawing.js").MapData} parts.drawing
   * @param {Texts} parts.texts
   */
  constructor({ config, places, store, whereabouts, visitor, map, drawing, texts }) {
    this.config = config;
    this.places = places;
    this.store = store;
    this.whereabouts = whereabouts;
    this.visitor = visitor;
    this.map = map;
    this.drawing = drawing;
    this.texts = texts;
    this.panel = byId("panel");
    this.snack = new Snack(byId("snack"));
    this.whereabouts.onMove = () => this.#showVisitor();
    byId("favourites-button").addEventListener("click", () => this.go(location.hash === "#favourites" ? "" : "favourites"));
    byId("menu").addEventListener("click", () => openMenu(this, /** @type {HTMLDialogElement} */ (byId("dialog"))));
    addEventListener("hashchange", () => this.show(true));
  }

  /** Say everything in this language from now on. @param {string} language */
  async speak(language) {
    this.store.change((memory) => void (memory.language = language));
    this.texts = await Texts.load(language);
    this.translate();
    this.show(true);
  }

  /** The parts of the page that are always there. */
  translate() {
    document.documentElement.lang = this.texts.language;
    document.title = this.texts.say("title");
    this.texts.fill(document);
    this.map.draw(this.drawing, this.texts.language);
  }

  /** @param {string} hash where to go */
  go(hash) {
    if (location.hash.replace("#", "") === hash) this.show(true);
    else location.hash = hash;
  }

  /** Show what the address says. @param {boolean} moved whether the keyboard follows */
  show(moved) {
    const [view, id] = location.hash.replace("#", "").split("/");
    const place = view === "place" ? this.places.get(id) : undefined;
    if (view === "favourites") this.#showFavourites();
    else if (view === "privacy") this.#put(privacyPage(this));
    else if (place) this.#showPlace(place);
    else this.#showSuggestion();
    this.#countFavourites();
    this.#showVisitor();
    if (moved) this.panel.querySelector("h2")?.focus({ preventScroll: true });
  }

  /** Ask for the next place and show it. */
  async next() {
    if (this.#asking) return;
    if (this.visitor.current?.verdict === "loved") this.snack.hide(); // going on means that it is meant
    if (location.hash) history.pushState(null, "", location.pathname + location.search);
    this.#asking = this.visitor.next();
    this.#put(waiting(this));
    try {
      await this.#asking;
    } finally {
      this.#asking = null;
      this.show(true);
    }
    this.#tellSuggestion();
  }

  /** "I love it." */
  love() {
    this.#decide("loved", () => this.visitor.love());
    this.show(true);
  }

  /** "Not for me": the next place comes at once. */
  dismiss() {
    this.#decide("dismissed", () => this.visitor.dismiss());
    return this.next();
  }

  /** @param {Place} place */
  removeFavourite(place) {
    const before = this.visitor.favourites;
    this.visitor.keep(place.id, false);
    const act = () => {
      this.store.change((memory) => void (memory.favourites = before.map(({ id }) => id)));
      this.show(true);
    };
    this.snack.show(this.texts.say("snack.removed", { name: this.#name(place) }), { label: this.texts.say("undo"), act });
    this.show(true);
  }

  /** By the device's own means, else the link is copied. @param {Place} place */
  async share(place) {
    const url = new URL(`#place/${place.id}`, location.href).href;
    try {
      if (navigator.share) return await navigator.share({ title: this.#name(place), url });
      await navigator.clipboard.writeText(url);
      this.snack.show(this.texts.say("snack.copied"));
    } catch {
      // the visitor has changed their mind, or the browser forbids it
    }
  }

  /**
   * Where a way to it begins: where the visitor is; while nobody knows that, where they were assumed to be then.
   * @param {import("./store.js").Suggestion} suggestion
   */
  startOf({ reason }) {
    const { point, located } = this.whereabouts.get();
    return located ? point : reason.here;
  }

  async locate() {
    const found = await this.whereabouts.start();
    if (!found) this.snack.show(this.texts.say("location.denied"));
    this.show(true);
  }

  stopLocating() {
    this.whereabouts.stop();
    this.show(true);
  }

  async install() {
    await this.installer?.prompt();
    this.installer = null;
  }

  /** Delete what is known of the visitor, here and at the server. */
  async forget() {
    this.snack.hide();
    const told = await this.visitor.forget();
    for (const name of (await globalThis.caches?.keys()) ?? []) await caches.delete(name);
    for (const worker of (await navigator.serviceWorker?.getRegistrations()) ?? []) await worker.unregister();
    this.texts = await Texts.load(chooseLanguage(navigator.languages));
    this.translate();
    history.pushState(null, "", location.pathname + location.search);
    this.show(true);
    this.snack.show(this.texts.say(told ? "forget.done" : "forget.half"));
  }

  /**
   * @param {"loved" | "dismissed"} verdict
   * @param {() => void} decide
   */
  #decide(verdict, decide) {
    const place = this.places.get(this.visitor.current?.id ?? "");
    if (!place) return;
    this.snack.hide(); // what was decided before is settled
    decide();
    const text = this.texts.say(`snack.${verdict}`, { name: this.#name(place) });
    const act = async () => {
      await this.#asking;
      this.visitor.undo();
      this.go("");
    };
    this.snack.show(text, { label: this.texts.say("undo"), act, ended: () => void this.visitor.settle() });
  }

  #showSuggestion() {
    if (this.#asking) return;
    const { current } = this.visitor;
    const place = this.places.get(current?.id ?? "");
    if (!current || !place || current.verdict === "dismissed") {
      this.#put(welcome(this));
      this.map.showCity();
      return;
    }
    this.#put(suggestionCard(this, current));
    this.map.showPlace(place, this.#name(place), this.startOf(current));
  }

  #showFavourites() {
    this.#put(favouritesList(this));
    const named = this.visitor.favourites.map((place) => ({ place, name: this.#name(place) }));
    this.map.showPlaces(named, ({ id }) => this.go(`place/${id}`));
  }

  /** @param {Place} place a favourite, or one that a link leads to */
  #showPlace(place) {
    const kept = this.visitor.favourites.includes(place);
    const change = () => {
      this.visitor.keep(place.id, !kept);
      this.show(true);
    };
    const actions = [
      button("back", this.texts.say("back"), () => this.go(kept ? "favourites" : ""), {}),
      kept
        ? button("bin", this.texts.say("remove"), change)
        : button("heart", this.texts.say("add"), change, { class: "love" }),
    ];
    const { point } = this.whereabouts.get();
    this.#put(placeCard(this, place, point, actions, null));
    this.map.showPlace(place, this.#name(place), point);
  }

  /** @param {Node} view */
  #put(view) {
    this.panel.replaceChildren(view);
    this.panel.scrollTop = 0;
  }

  #countFavourites() {
    const open = location.hash === "#favourites";
    const pill = byId("favourites-button");
    const { length } = this.visitor.favourites;
    const words = this.texts.say(open ? "favourites.hide" : "favourites.show");
    /** @type {HTMLElement} */ (pill.querySelector(".words")).textContent = words;
    /** @type {HTMLElement} */ (pill.querySelector(".count")).textContent = length ? String(length) : "";
    pill.classList.toggle("open", open);
  }

  #showVisitor() {
    const { point, located } = this.whereabouts.get();
    const { current } = this.visitor;
    const start = current && !location.hash ? this.startOf(current) : point;
    this.map.showVisitor(start, located, this.texts.say(located ? "location.here" : "location.assumed"));
  }

  #tellSuggestion() {
    const place = this.places.get(this.visitor.current?.id ?? "");
    if (!place) return;
    const kind = this.texts.say(`type.${place.type}`);
    byId("told").textContent = this.texts.say("suggested", { name: this.#name(place), kind });
  }

  /** @param {Place} place */
  #name(place) {
    return this.places.name(place, this.texts.language);
  }
}
