// @ts-check
/** The learning curve of a run: asked for, drawn by uPlot in the colours of the page, and said in words. */

import { ask } from "./ask.js";
import { element, number, part, say } from "./dom.js";
import { BANDS, coloursOf, COLOURS, dataOf, HEIGHT, optionsOf } from "./plot.js";

/** @typedef {import("./plot.js").Line} Line */
/** @typedef {{version: number, behind: boolean, lines: Line[], by: string}} Answer */

const uPlot = /** @type {any} */ (globalThis).uPlot;
const NAMED = 16; // lines
const EXPLANATION = "Points: returns of single episodes. Line: mean of the last 100. Band: one standard deviation.";
const TURNS = /** @type {Record<string, number>} */ ({ ArrowLeft: -1, ArrowRight: 1, Home: -Infinity, End: Infinity });

export class Curve {
  /** @type {any} */
  #plot = null;
  /** What the plot was made for. */
  #shape = "";
  /** @type {Answer | null} */
  answer = null;

  /**
   * @param {HTMLElement} root has the parts chart, by, run, legend and summary, and the address of the curve in `data-curve`
   */
  constructor(root) {
    this.root = root;
    this.chart = part(root, "chart");
    this.by = /** @type {HTMLSelectElement} */ (part(root, "by"));
    this.run = /** @type {HTMLSelectElement} */ (part(root, "run"));
    this.chart.addEventListener("keydown", (event) => this.#turn(event));
    this.chart.addEventListener("blur", () => this.#plot?.setCursor({ left: -10, top: -10 }));
    new ResizeObserver(() => this.#plot?.setSize({ width: this.chart.clientWidth, height: HEIGHT })).observe(this.chart);
  }

  /** Whether the server is still summing up. */
  get behind() {
    return this.answer?.behind ?? false;
  }

  /** How many episodes there are; the newest mean and deviation, while there is one line. */
  get last() {
    const lines = this.answer?.lines ?? [];
    const episodes = lines.reduce((sum, line) => sum + (line.x.at(-1) ?? 0), 0);
    const [line] = lines.length === 1 ? lines : [];
    return { episodes, mean: line?.mean.at(-1), deviation: line?.deviation.at(-1) };
  }

  /** Ask for what is new, and draw it. Fails when the server does not answer. */
  async update() {
    const asked = this.by.value, known = this.answer;
    const version = known && known.by === asked && !known.behind ? known.version : "";
    const answer = await ask(this.root.dataset.curve ?? "", { run: this.run.value, by: asked, version });
    if (asked !== this.by.value || answer.unchanged) return; // something else was chosen in the meantime
    this.answer = { ...answer, by: asked, lines: answer.lines.filter((/** @type {Line} */ line) => line.x.length) };
    this.draw();
  }

  /** Draw what is known, in the colours that the page has now. */
  draw() {
    if (!this.answer) return;
    const { lines } = this.answer, colours = coloursOf(this.chart);
    const shape = JSON.stringify([lines.map((line) => line.name), colours]);
    if (this.#plot && shape === this.#shape && lines.length) this.#plot.setData(dataOf(lines));
    else this.#make(lines, colours);
    this.#shape = shape;
    this.#summarise();
    this.#explain();
  }

  /**
   * @param {Line[]} lines
   * @param {import("./plot.js").Colours} colours
   */
  #make(lines, colours) {
    this.#plot?.destroy();
    this.#plot = null;
    const nothing = this.behind ? "The returns are being summed up…" : "No episode has ended yet. The curve appears with the first.";
    this.chart.replaceChildren(...(lines.length ? [] : [element("div", nothing, "sh-empty")]));
    if (!lines.length) return;
    const hooks = { setCursor: [() => this.#explain()] };
    this.#plot = new uPlot({ ...optionsOf(lines, colours, this.chart.clientWidth), hooks }, dataOf(lines), this.chart);
  }

  /** Keys go from point to point. @param {KeyboardEvent} event */
  #turn(event) {
    const turn = TURNS[event.key];
    if (!this.#plot || turn === undefined) return;
    event.preventDefault();
    const x = this.#plot.data[0], before = this.#plot.cursor.idx ?? x.length;
    const to = Math.min(x.length - 1, Math.max(0, before + turn));
    this.#plot.setCursor({ left: this.#plot.valToPos(x[to], "x"), top: 1 });
  }

  /** What stands below: the episode under the cursor, or which line is which. */
  #explain() {
    const legend = part(this.root, "legend"), i = this.#plot?.cursor.idx;
    if (i !== null && i !== undefined) say(legend, this.#describe(i));
    else if (this.by.value === "execution" && this.answer?.lines.length) this.#nameLines(legend, this.answer.lines);
    else say(legend, EXPLANATION);
  }

  /** @param {number} i which point */
  #describe(i) {
    const { lines } = /** @type {Answer} */ (this.answer), { data } = this.#plot;
    const words = lines.map((line, l) => {
      const [value, mean, high] = [1, 2, 3].map((column) => data[4 * l + column]?.[i]);
      if (mean === null || mean === undefined) return null;
      const name = lines.length > 1 ? `${line.name}: ` : "";
      return `${name}return ${number(value, 2)}, mean ${number(mean, 2)} ± ${number(high - mean, 2)}`;
    });
    return `Episode ${number(data[0][i])}. ${words.filter(Boolean).slice(0, BANDS).join("; ")}`;
  }

  /**
   * @param {HTMLElement} legend
   * @param {Line[]} lines
   */
  #nameLines(legend, lines) {
    const keys = lines.slice(0, NAMED).map((line, i) => {
      const key = element("span", undefined, "sh-key"), swatch = element("i");
      swatch.style.background = COLOURS[i % COLOURS.length];
      key.append(swatch, line.name);
      return key;
    });
    const more = lines.length > NAMED ? [`and ${lines.length - NAMED} more`] : [];
    if (legend.textContent !== keys.map((key) => key.textContent).join("") + more.join("")) legend.replaceChildren(...keys, ...more);
  }

  #summarise() {
    const { episodes, mean, deviation } = this.last;
    const last = mean === undefined ? "" : `, last 100: ${number(mean, 2)} ± ${number(deviation, 2)}`;
    const text = episodes ? `${number(episodes)} episodes${last}${this.behind ? " (summing up…)" : ""}` : "";
    say(part(this.root, "summary"), text);
    this.chart.setAttribute("aria-label", `Learning curve. ${text || "No episode has ended yet"}. The arrow keys read single points.`);
  }
}
