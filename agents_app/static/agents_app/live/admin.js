// @ts-check
/** The live part of an agent's page in the administration. */

import { ask, forever } from "./ask.js";
import { Curve } from "./curve.js";
import { element, part, say } from "./dom.js";
import { showExecutions } from "./executions.js";
import { AdviceGraph } from "./graph.js";

/** @typedef {{id: number, at: string, summary: string, traceback: string}} Failure */

const AWAY = "The server cannot be reached, or you are logged out. Trying again…";

/** @param {HTMLElement} root */
function start(root) {
  const curve = new Curve(root);
  const graph = new AdviceGraph(part(root, "advice"), part(root, "advice-words"));
  const update = () => Promise.all([curve.update(), updateLive(root, graph)]).catch(() => say(part(root, "notice"), AWAY));
  curve.by.addEventListener("change", update);
  curve.run.addEventListener("change", () => void (location.search = `?run=${curve.run.value}`)); // downloads and actions follow
  new MutationObserver(() => curve.draw()).observe(document.documentElement, { attributes: true, attributeFilter: ["class"] });
  void forever(update, () => curve.behind);
}

/**
 * @param {HTMLElement} root
 * @param {AdviceGraph} graph
 */
async function updateLive(root, graph) {
  const live = await ask(root.dataset.live ?? "");
  say(part(root, "notice"), live.notice);
  showExecutions(/** @type {HTMLTableElement} */ (part(root, "executions")), live.executions);
  graph.show(live.executions);
  part(root, "advice-words").hidden = Boolean(live.notice);
  showErrors(root, live.errors);
}

/**
 * @param {HTMLElement} root
 * @param {Failure[]} errors
 */
function showErrors(root, errors) {
  const place = part(root, "errors"), ids = errors.map((error) => error.id).join();
  part(root, "errors-card").hidden = !errors.length;
  if (place.dataset.ids === ids) return; // leave what is folded open
  place.dataset.ids = ids;
  place.replaceChildren(...errors.map(describeError));
}

/** @param {Failure} error */
function describeError({ at, summary, traceback }) {
  const made = element("details", undefined, "sh-error"), line = element("summary", summary);
  line.append(element("span", `  ${new Date(at).toLocaleString()}`, "sh-quiet"));
  made.append(line, element("pre", traceback));
  return made;
}

const root = document.getElementById("shepherd-live");
if (root) start(root);
