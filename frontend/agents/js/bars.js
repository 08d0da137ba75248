// @ts-check
/** Bars, as tables and lists that can be read out. */

import { element, number } from "/static/agents_app/live/dom.js";
import { mean } from "./tally.js";

/** @typedef {import("./tally.js").Sum} Sum */
/** @typedef {(value: number) => string} Words a mean for people */

/**
 * A row for each sum: its name, a bar as long as its mean, the mean, and of how many.
 * @param {HTMLTableElement} table
 * @param {[name: string, sum: Sum][]} named
 * @param {Words} words
 */
export function showBars(table, named, words) {
  const longest = Math.max(...named.map(([, sum]) => Math.abs(mean(sum))), 0);
  table.replaceChildren(...named.map(([name, sum]) => row(name, sum, longest, words)));
}

/**
 * A column for each hour of the day. Returns in words which is the highest; empty: there is none.
 * @param {HTMLElement} list
 * @param {Map<number, Sum>} hours
 * @param {Words} words
 */
export function showHours(list, hours, words) {
  const highest = Math.max(...[...hours.values()].map((sum) => Math.abs(mean(sum))), 0);
  const columns = Array.from({ length: 24 }, (_, hour) => column(hour, hours.get(hour), highest, words));
  list.replaceChildren(...columns);
  const [best] = [...hours].sort(([, a], [, b]) => mean(b) - mean(a));
  return best ? `Highest at ${best[0]}:00: ${words(mean(best[1]))}` : "";
}

/**
 * @param {string} name
 * @param {Sum} sum
 * @param {number} longest
 * @param {Words} words
 */
function row(name, sum, longest, words) {
  const made = element("tr"), head = element("th", name), cell = element("td", undefined, "bar");
  head.scope = "row";
  cell.append(bar("width", mean(sum), longest));
  made.append(head, cell, element("td", words(mean(sum))), element("td", `of ${number(sum.count)}`, "sh-quiet"));
  return made;
}

/**
 * @param {number} hour
 * @param {Sum | undefined} sum
 * @param {number} highest
 * @param {Words} words
 */
function column(hour, sum, highest, words) {
  const made = element("li"), told = sum ? `${hour}:00: ${words(mean(sum))} of ${number(sum.count)}` : `${hour}:00: nothing`;
  made.title = told;
  const label = element("span", hour % 6 ? "" : String(hour), "hour");
  label.setAttribute("aria-hidden", "true");
  made.append(bar("height", sum ? mean(sum) : 0, highest), label, element("span", told, "unseen"));
  return made;
}

/**
 * @param {"width" | "height"} side
 * @param {number} value
 * @param {number} longest
 */
function bar(side, value, longest) {
  const made = element("i", undefined, value < 0 ? "below" : "");
  made.style[side] = `${longest ? (100 * Math.abs(value)) / longest : 0}%`;
  return made;
}
