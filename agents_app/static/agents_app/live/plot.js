// @ts-check
/** How uPlot draws a learning curve: a line with points and a band for each of its lines. */

/**
 * Arrays of one length: the number of the episode, a return, and mean and standard deviation of the 100 until then.
 * @typedef {{name: string, x: number[], value: number[], mean: number[], deviation: number[]}} Line
 */
/** @typedef {{axis: string, grid: string, points: number}} Colours */

export const HEIGHT = 320; // pixels
export const BANDS = 4; // lines; with more, bands and points would hide each other
export const COLOURS = ["#0d9488", "#7c3aed", "#ea580c", "#2563eb", "#db2777", "#65a30d", "#ca8a04", "#64748b"];
const FONT = "12px system-ui, sans-serif";

/**
 * What the page's style sheet says.
 * @param {HTMLElement} place
 * @returns {Colours}
 */
export function coloursOf(place) {
  const style = getComputedStyle(place);
  return {
    axis: style.getPropertyValue("--sh-quiet").trim(),
    grid: style.getPropertyValue("--sh-line").trim(),
    points: Number(style.getPropertyValue("--sh-points")),
  };
}

/**
 * uPlot wants one x for all: x, then per line sample, mean, high, low.
 * @param {Line[]} lines
 */
export function dataOf(lines) {
  const tables = lines.map(({ x, value, mean, deviation }) => [
    x, value, mean, mean.map((at, i) => at + deviation[i]), mean.map((at, i) => at - deviation[i]),
  ]);
  return tables.length === 1 ? tables[0] : /** @type {any} */ (globalThis).uPlot.join(tables);
}

/**
 * @param {Line[]} lines
 * @param {Colours} colours
 * @param {number} width pixels
 */
export function optionsOf(lines, { axis, grid, points }, width) {
  const style = { stroke: axis, grid: { stroke: grid, width: 1 }, ticks: { show: false }, font: FONT };
  const banded = lines.length <= BANDS;
  const series = lines.flatMap((_, i) => seriesOf(COLOURS[i % COLOURS.length], banded, points));
  const bands = lines.map((_, i) => ({ series: [4 * i + 3, 4 * i + 4], fill: faint(COLOURS[i % COLOURS.length], 0.15) }));
  return {
    width, height: HEIGHT, series: [{}, ...series], bands: banded ? bands : [], legend: { show: false },
    scales: { x: { time: false } }, cursor: { points: { show: false } },
    axes: [{ ...style, label: "Episode", labelFont: FONT, labelSize: 18, labelGap: 0, size: 28, gap: 4 }, { ...style, size: 52 }],
  };
}

/**
 * Of one line: the samples, the mean, and both edges of the band.
 * @param {string} colour
 * @param {boolean} banded
 * @param {number} points how solid they are, 0 to 1
 */
function seriesOf(colour, banded, points) {
  const edge = { stroke: "#0000", spanGaps: true, points: { show: false }, show: banded };
  return [
    { stroke: "#0000", points: { show: banded, size: 4, width: 0, fill: faint(colour, points) } },
    { stroke: colour, width: 2, spanGaps: true, points: { show: false } },
    edge,
    { ...edge },
  ];
}

/**
 * @param {string} colour #rrggbb
 * @param {number} share how solid, 0 to 1
 */
function faint(colour, share) {
  return colour + Math.round(share * 255).toString(16).padStart(2, "0");
}
