// @ts-check
/** A line at the bottom that says what happened, and for a while lets it be undone. */

import { h } from "./dom.js";

const SECONDS = 7;

export class Snack {
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  #timer;
  #ended = () => {};

  /** @param {HTMLElement} where */
  constructor(where) {
    this.where = where;
  }

  /**
   * @param {string} text
   * @param {{label: string, act: () => void, ended?: () => void} | null} [undo] `ended` is called when it is too late
   */
  show(text, undo = null) {
    this.hide();
    this.#ended = undo?.ended ?? (() => {});
    const act = () => {
      this.#ended = () => {};
      this.hide();
      undo?.act();
    };
    this.where.replaceChildren(
      h("div", { class: "snack" }, h("span", {}, text), undo && h("button", { type: "button", onclick: act }, undo.label)),
    );
    this.#timer = setTimeout(() => this.hide(), SECONDS * 1000);
  }

  hide() {
    clearTimeout(this.#timer);
    this.where.replaceChildren();
    const ended = this.#ended;
    this.#ended = () => {};
    ended();
  }
}
