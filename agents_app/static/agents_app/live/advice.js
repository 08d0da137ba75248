// @ts-check
/** Who advises whom, among the live executions and with other agents that advise them. */

/** @typedef {import("./executions.js").Execution} Execution */
/** @typedef {[from: string, to: string]} Arrow from whoever advises to whoever listens */

/** @param {Execution[]} executions @returns {Arrow[]} */
export function arrowsOf(executions) {
  return executions.flatMap((e) => (e.advisors ?? []).map((from) => /** @type {Arrow} */ ([String(from), String(e.number)])));
}

/**
 * The agents that advise: whoever is no live execution.
 * @param {Execution[]} executions
 */
export function agentsOf(executions) {
  const names = new Set(executions.map((e) => String(e.number)));
  return [...new Set(arrowsOf(executions).map(([from]) => from).filter((from) => !names.has(from)))];
}

/**
 * All of it in words.
 * @param {Execution[]} executions
 */
export function sentenceOf(executions) {
  const { length } = executions;
  if (!length) return "No execution is running. The next step of a client starts one.";
  const agents = agentsOf(executions), pairs = length * (length - 1);
  const among = arrowsOf(executions).filter(([from]) => !agents.includes(from)).length;
  const words = [];
  if (among) words.push(among === pairs ? `All ${length} executions advise each other.` : `${among} of ${pairs} pairs of executions advise.`);
  if (agents.length) words.push(`Advised by ${agents.join(", ")}.`);
  if (!words.length) words.push(length === 1 ? "One execution, which nobody advises." : `${length} executions, and none is advised now.`);
  return words.join(" ");
}
