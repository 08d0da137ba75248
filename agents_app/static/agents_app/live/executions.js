// @ts-check
/** The live executions as a table. */

import { element, number } from "./dom.js";

/**
 * What an execution says of itself (agents_app.fleet.ExecutionStatus). Absent: not known yet, or not told.
 * @typedef {object} Execution
 * @property {number} number
 * @property {string} [state]
 * @property {number} [sessions]
 * @property {number} [episodes]
 * @property {number} [steps]
 * @property {number} [steps_per_second]
 * @property {number} [updates]
 * @property {number | null} [mean_return]
 * @property {number} [cpu_percent]
 * @property {number} [memory] bytes
 * @property {(number | string)[]} [advisors]
 * @property {number[]} [advises]
 */

/** By what stands in the table's head. @type {Record<string, (execution: Execution) => string>} */
const COLUMNS = {
  "No.": (e) => String(e.number),
  State: (e) => e.state ?? "",
  Sessions: (e) => number(e.sessions),
  Episodes: (e) => number(e.episodes),
  Steps: (e) => number(e.steps),
  "Steps/s": (e) => number(e.steps_per_second, 1),
  Updates: (e) => number(e.updates),
  "Mean return": (e) => number(e.mean_return, 2),
  CPU: (e) => (e.cpu_percent === undefined ? "–" : `${number(e.cpu_percent)} %`),
  Memory: (e) => (e.memory === undefined ? "–" : `${number(e.memory / 1e6, 1)} MB`),
  "Advised by": (e) => list(e.advisors),
  Advises: (e) => list(e.advises),
};

/**
 * Fill the table's body with what its head names; a table without executions is hidden.
 * @param {HTMLTableElement} table
 * @param {Execution[]} executions
 */
export function showExecutions(table, executions) {
  const names = [...table.querySelectorAll("th")].map((head) => head.textContent?.trim() ?? "");
  table.tBodies[0].replaceChildren(...executions.map((execution) => row(execution, names)));
  table.hidden = !executions.length;
}

/**
 * @param {Execution} execution
 * @param {string[]} names
 */
function row(execution, names) {
  const made = element("tr");
  made.append(...names.map((name) => cell(name, COLUMNS[name](execution))));
  return made;
}

/**
 * @param {string} name
 * @param {string} text
 */
function cell(name, text) {
  if (name !== "State") return element("td", text);
  const made = element("td");
  made.append(element("span", text, `sh-badge ${text === "stopping" ? "sh-warn" : "sh-good"}`));
  return made;
}

/** @param {(number | string)[]} [names] */
function list(names) {
  return names?.length ? names.join(", ") : "–";
}
