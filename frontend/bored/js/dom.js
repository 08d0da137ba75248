// @ts-check
/** Making elements. */

import { icon } from "./icons.js";

/**
 * An element with attributes and children. `on...` are listeners; null and false are left out; texts are texts, never HTML.
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} name
 * @param {Record<string, any>} attributes
 * @param {...(Node | string | null | false)} children
 * @returns {HTMLElementTagNameMap[K]}
 */
export function h(name, attributes, ...children) {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else if (value === true) node.setAttribute(key, "");
    else if (value !== null && value !== false) node.setAttribute(key, String(value));
  }
  node.append(...children.filter((child) => child !== null && child !== false));
  return node;
}

/**
 * @param {string} symbol
 * @param {string} text
 * @param {() => void} act
 * @param {Record<string, any>} [attributes]
 */
export function button(symbol, text, act, attributes = {}) {
  return h("button", { type: "button", onclick: act, ...attributes }, icon(symbol), h("span", {}, text));
}

/**
 * A button that is only an icon.
 * @param {string} symbol
 * @param {string} label
 * @param {() => void} act
 */
export function iconButton(symbol, label, act) {
  return h("button", { type: "button", class: "round", "aria-label": label, title: label, onclick: act }, icon(symbol));
}

/**
 * A link that leaves the page.
 * @param {string} symbol
 * @param {string} text
 * @param {string} href
 */
export function link(symbol, text, href) {
  return h("a", { href, target: "_blank", rel: "noopener noreferrer", class: "button" }, icon(symbol), h("span", {}, text));
}
