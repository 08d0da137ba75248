// @ts-check
/** The live page of an agent: asks every few seconds, and shows what has changed. */

import { ask, forever } from "/static/agents_app/live/ask.js";
import { Curve } from "/static/agents_app/live/curve.js";
import { number, part, say } from "/static/agents_app/live/dom.js";
import { showExecutions } from "/static/agents_app/live/executions.js";
import { AdviceGraph } from "/static/agents_app/live/graph.js";
import { Actions } from "./actions.js";

/** @typedef {import("/static/agents_app/live/executions.js").Execution} Execution */

const AWAY = "The server cannot be reached. Trying again…";

/** @param {HTMLElement} root */
async function start(root) {
  const curve = new Curve(root);
  const graph = new AdviceGraph(part(root, "advice"), part(root, "advice-words"));
  const actions = await Actions.of(root, curve.run.value);
  const update = () =>
    Promise.all([curve.update().then(() => showReturns(root, curve)), updateExecutions(root, graph), actions?.update()])
      .then(([, notice]) => say(part(root, "notice"), notice), () => say(part(root, "notice"), AWAY));
  curve.by.addEventListener("change", update);
  curve.run.addEventListener("change", () => void (location.search = `?run=${curve.run.value}`));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => curve.draw());
  void forever(update, () => curve.behind);
}

/**
 * @param {HTMLElement} root
 * @param {Curve} curve
 */
function showReturns(root, { last }) {
  say(part(root, "episodes"), number(last.episodes));
  if (last.mean !== undefined || !last.episodes) say(part(root, "mean"), number(last.mean, 2));
}

/**
 * Returns what is to be told.
 * @param {HTMLElement} root
 * @param {AdviceGraph} graph
 * @returns {Promise<string>}
 */
async function updateExecutions(root, graph) {
  const { executions, notice } = await ask(root.dataset.executions ?? "");
  const speed = executions.reduce((/** @type {number} */ sum, /** @type {Execution} */ e) => sum + (e.steps_per_second ?? 0), 0);
  say(part(root, "speed"), number(speed, speed < 10 ? 1 : 0));
  say(part(root, "live"), number(executions.length));
  showExecutions(/** @type {HTMLTableElement} */ (part(root, "executions")), executions);
  graph.show(executions);
  part(root, "advice-words").hidden = Boolean(notice);
  return notice;
}

void start(/** @type {HTMLElement} */ (document.getElementById("agent")));
