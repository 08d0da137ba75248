// @ts-check
/** A drawing of who advises whom: arrows between executions in a ring, and agents that advise them in its middle. */

import { agentsOf, arrowsOf, sentenceOf } from "./advice.js";
import { say } from "./dom.js";

/** @typedef {import("./executions.js").Execution} Execution */
/** @typedef {{name: string, x: number, y: number, agent: boolean}} Stand */

const SVG = "http://www.w3.org/2000/svg";
const WIDTH = 360, HEIGHT = 270, MARGIN = 30, RADIUS = 18, LETTER = 7;
const BEND = 0.13; // of an arrow's length, to its left: so that two arrows between the same two lie apart
const CROWD = 24; // arrows; more are drawn faintly
const ROOM = 32; // executions
const LETTERS = 18; // of an agent's name

export class AdviceGraph {
  #shape = "";
  /** Steps of each execution when it was looked at last. @type {Map<number, number>} */
  #steps = new Map();

  /**
   * @param {HTMLElement} place
   * @param {HTMLElement} words where it is said in words, for everybody who does not see the drawing, too
   */
  constructor(place, words) {
    this.place = place;
    this.words = words;
  }

  /** @param {Execution[]} executions */
  show(executions) {
    const shown = executions.slice(0, ROOM);
    const shape = JSON.stringify([shown.map((e) => e.number), arrowsOf(shown)]);
    if (shape !== this.#shape) this.place.replaceChildren(draw(shown));
    this.#shape = shape;
    this.place.hidden = standsOf(shown).length < 2; // one alone is no graph
    for (const execution of shown) this.#mark(execution);
    say(this.words, sentenceOf(executions));
  }

  /** Whoever acts is filled, and advice flows to whoever has stepped since. @param {Execution} execution */
  #mark({ number, state = "", steps = 0, steps_per_second: speed = 0 }) {
    const moves = steps !== (this.#steps.get(number) ?? steps);
    this.#steps.set(number, steps);
    const stand = this.place.querySelector(`[data-stand="${number}"]`);
    const title = stand?.querySelector("title");
    stand?.setAttribute("class", `stand ${state}`);
    if (title) title.textContent = `Execution ${number}: ${state}, ${speed.toFixed(1)} steps a second`;
    for (const arrow of this.place.querySelectorAll(`[data-to="${number}"]`)) arrow.classList.toggle("flows", moves);
  }
}

/** @param {Execution[]} executions */
function draw(executions) {
  const arrows = arrowsOf(executions), stands = standsOf(executions);
  const svg = node("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: arrows.length > CROWD ? "sh-advice crowd" : "sh-advice", "aria-hidden": "true" });
  const by = new Map(stands.map((stand) => [stand.name, stand]));
  svg.append(head());
  for (const [from, to] of arrows) svg.append(arrow(/** @type {Stand} */ (by.get(from)), /** @type {Stand} */ (by.get(to))));
  svg.append(...stands.map((stand) => (stand.agent ? agentSign(stand) : executionSign(stand))));
  return svg;
}

/**
 * The first execution stands above; two stand side by side.
 * @param {Execution[]} executions
 * @returns {Stand[]}
 */
function standsOf(executions) {
  const agents = agentsOf(executions), count = executions.length;
  const [across, down] = [WIDTH / 2 - MARGIN, HEIGHT / 2 - MARGIN];
  const ring = executions.map(({ number }, i) => {
    const turn = 2 * Math.PI * (i / count - (count === 2 ? 0.5 : 0.25));
    return { name: String(number), x: WIDTH / 2 + across * Math.cos(turn), y: HEIGHT / 2 + down * Math.sin(turn), agent: false };
  });
  const middle = agents.map((name, i) => ({ name, x: (WIDTH * (i + 1)) / (agents.length + 1), y: HEIGHT / 2, agent: true }));
  return [...ring, ...middle];
}

/**
 * @param {Stand} from
 * @param {Stand} to
 */
function arrow(from, to) {
  const [dx, dy] = [to.x - from.x, to.y - from.y];
  const middle = [from.x + dx / 2 + dy * BEND, from.y + dy / 2 - dx * BEND];
  const start = edge(from, middle, RADIUS + 3), end = edge(to, middle, RADIUS + 6);
  const d = `M${start}Q${middle.map((at) => at.toFixed(1)).join(" ")} ${end}`;
  return node("path", { d, class: "arrow", "data-to": to.name, "marker-end": "url(#sh-head)" });
}

/**
 * The point near a stand that lies towards another point.
 * @param {Stand} stand
 * @param {number[]} towards
 * @param {number} radius
 */
function edge({ x, y }, [towardsX, towardsY], radius) {
  const far = Math.hypot(towardsX - x, towardsY - y) || 1;
  return `${(x + ((towardsX - x) / far) * radius).toFixed(1)} ${(y + ((towardsY - y) / far) * radius).toFixed(1)}`;
}

/** @param {Stand} stand */
function executionSign({ name, x, y }) {
  return sign(x, y, { class: "stand", "data-stand": name }, node("circle", { r: RADIUS }), name, `Execution ${name}`);
}

/** @param {Stand} stand */
function agentSign({ name, x, y }) {
  const text = name.length > LETTERS ? `${name.slice(0, LETTERS - 1)}…` : name;
  const width = text.length * LETTER + 22;
  const body = node("rect", { x: -width / 2, y: -RADIUS, width, height: 2 * RADIUS, rx: 6 });
  return sign(x, y, { class: "stand agent" }, body, text, `${name} advises`);
}

/**
 * @param {number} x
 * @param {number} y
 * @param {Record<string, string>} attributes
 * @param {SVGElement} body
 * @param {string} words within it
 * @param {string} told when somebody points at it
 */
function sign(x, y, attributes, body, words, told) {
  const group = node("g", { ...attributes, transform: `translate(${x.toFixed(1)} ${y.toFixed(1)})` });
  const text = node("text", {}), title = node("title", {});
  text.textContent = words;
  title.textContent = told;
  group.append(title, body, text);
  return group;
}

/** The head of all arrows. */
function head() {
  const size = { viewBox: "0 0 8 8", refX: 5, refY: 4, markerWidth: 8, markerHeight: 8, markerUnits: "userSpaceOnUse" };
  const marker = node("marker", { id: "sh-head", orient: "auto", ...size });
  marker.append(node("path", { d: "M0 0.5 8 4 0 7.5z" }));
  return marker;
}

/**
 * @param {string} name
 * @param {Record<string, string | number>} attributes
 */
function node(name, attributes) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, String(value));
  return made;
}
