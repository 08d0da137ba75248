// The live part of an agent's admin page: polls the curve and the executions, and draws them. Only text goes into the page.
(() => {
  const root = document.getElementById("shepherd-live");
  if (!root) return;
  const EVERY = 2000, BANDS = 4;
  const COLOURS = ["#0d9488", "#7c3aed", "#ea580c", "#2563eb", "#db2777", "#65a30d", "#ca8a04", "#64748b"];
  const part = (name) => root.querySelector(`[data-part="${name}"]`);
  const chart = part("chart"), by = part("by"), run = part("run");
  let plot = null, curve = null;

  const number = (value, digits = 0) =>
    value === null || value === undefined ? "–" : Number(value).toLocaleString("en", { maximumFractionDigits: digits });
  const dark = () => document.documentElement.classList.contains("dark");
  const alpha = (colour, share) => colour + Math.round(share * 255).toString(16).padStart(2, "0");

  function element(tag, text, className) {
    const made = document.createElement(tag);
    if (text !== undefined) made.textContent = text;
    if (className) made.className = className;
    return made;
  }

  async function get(url, parameters) {
    const answer = await fetch(`${url}?${new URLSearchParams(parameters)}`, { headers: { Accept: "application/json" }, redirect: "error" });
    if (!answer.ok) throw new Error(`The server answered ${answer.status}.`);
    return answer.json();
  }

  // --- the curve ---
  function data(lines) { // uPlot wants one x for all: x, then per line sample, mean, high, low
    const tables = lines.map((line) => [
      line.x, line.value, line.mean,
      line.mean.map((mean, i) => mean + line.deviation[i]), line.mean.map((mean, i) => mean - line.deviation[i]),
    ]);
    return tables.length === 1 ? tables[0] : uPlot.join(tables);
  }

  function options(lines) {
    const axis = { stroke: dark() ? "#9ca3af" : "#6b7280", grid: { stroke: dark() ? "#ffffff14" : "#00000010", width: 1 }, ticks: { show: false } };
    const series = [{ label: "episode" }], bands = [];
    lines.forEach((line, i) => {
      const colour = COLOURS[i % COLOURS.length], first = series.length, banded = lines.length <= BANDS;
      series.push({ stroke: "#0000", points: { show: banded, size: 4, width: 0, fill: alpha(colour, dark() ? 0.45 : 0.4) } });
      series.push({ stroke: colour, width: 2, spanGaps: true, points: { show: false } });
      for (let side = 0; side < 2; side++) series.push({ stroke: "#0000", spanGaps: true, points: { show: false }, show: banded });
      if (banded) bands.push({ series: [first + 2, first + 3], fill: alpha(colour, 0.15) });
    });
    return {
      width: chart.clientWidth, height: 320, series, bands, legend: { show: false }, scales: { x: { time: false } },
      axes: [{ ...axis, label: "Episode", labelFont: "12px Inter, sans-serif", labelSize: 18, labelGap: 0, size: 28, gap: 4 }, { ...axis, size: 60 }],
      cursor: { points: { show: false } }, hooks: { setCursor: [describe] },
    };
  }

  function describe(drawn) {
    const i = drawn.cursor.idx;
    if (i === null || i === undefined) return legend();
    const words = curve.lines.map((line, l) => {
      const [value, mean, high] = [1, 2, 3].map((k) => drawn.data[4 * l + k][i]);
      if (mean === null || mean === undefined) return null;
      const name = curve.lines.length > 1 ? `${line.name}: ` : "";
      return `${name}return ${number(value, 2)}, mean ${number(mean, 2)} ± ${number(high - mean, 2)}`;
    });
    part("legend").textContent = `Episode ${number(drawn.data[0][i])}. ${words.filter(Boolean).slice(0, 4).join("; ")}`;
  }

  function legend() {
    const place = part("legend");
    place.textContent = "Points: returns of single episodes. Line: mean of the last 100. Band: one standard deviation.";
    if (by.value !== "execution" || !curve) return;
    place.textContent = "";
    curve.lines.slice(0, 16).forEach((line, i) => {
      const key = element("span", undefined, "sh-key"), swatch = element("i");
      swatch.style.background = COLOURS[i % COLOURS.length];
      key.append(swatch, line.name);
      place.append(key);
    });
    if (curve.lines.length > 16) place.append(`and ${curve.lines.length - 16} more`);
  }

  function draw() {
    const lines = curve.lines.filter((line) => line.x.length);
    curve.lines = lines;
    const shape = JSON.stringify([lines.map((line) => line.name), dark()]);
    if (!lines.length) {
      if (plot) plot.destroy();
      plot = null;
      chart.replaceChildren(element("div", curve.behind ? "The returns are being summed up…" : "No episode has ended yet. The curve appears with the first.", "sh-empty"));
    } else if (plot && chart.dataset.shape === shape) {
      plot.setData(data(lines));
    } else {
      if (plot) plot.destroy();
      chart.replaceChildren();
      plot = new uPlot(options(lines), data(lines), chart);
      chart.dataset.shape = shape;
    }
    summarise(lines);
    legend();
  }

  function summarise(lines) {
    const episodes = lines.reduce((sum, line) => sum + line.x[line.x.length - 1], 0);
    const last = lines.length === 1 ? `, last 100: ${number(lines[0].mean.at(-1), 2)} ± ${number(lines[0].deviation.at(-1), 2)}` : "";
    part("summary").textContent = episodes ? `${number(episodes)} episodes${last}${curve.behind ? " (summing up…)" : ""}` : "";
    root.dataset.episodes = episodes;
  }

  async function updateCurve() {
    const asked = by.value;
    const version = curve && curve.by === asked && !curve.behind ? curve.version : "";
    const answer = await get(root.dataset.curve, { run: run.value, by: asked, version });
    if (asked !== by.value || answer.unchanged) return; // something else was chosen in the meantime
    curve = { ...answer, by: asked };
    draw();
  }

  // --- the executions and errors ---
  function row(e) {
    const list = (numbers) => (numbers && numbers.length ? numbers.join(", ") : "–");
    const made = element("tr"), state = element("td");
    state.append(element("span", e.state ?? "", `sh-badge ${e.state === "stopping" ? "sh-warn" : "sh-good"}`));
    made.append(element("td", e.number ?? ""), state);
    const cells = [
      number(e.sessions), number(e.episodes), number(e.steps), number(e.steps_per_second, 1), number(e.updates), number(e.mean_return, 2),
      e.cpu_percent === undefined ? "–" : `${number(e.cpu_percent)} %`, e.memory === undefined ? "–" : `${number(e.memory / 1e6, 1)} MB`,
      list(e.advisors), list(e.advises),
    ];
    made.append(...cells.map((text) => element("td", text)));
    return made;
  }

  function showErrors(errors) {
    const known = part("errors").dataset.ids, ids = errors.map((error) => error.id).join();
    part("errors-card").hidden = !errors.length;
    if (known === ids) return; // leave what is folded open
    part("errors").dataset.ids = ids;
    part("errors").replaceChildren(...errors.map((error) => {
      const made = element("details", undefined, "sh-error"), summary = element("summary", error.summary);
      summary.append(element("span", `  ${new Date(error.at).toLocaleString()}`, "sh-quiet"));
      made.append(summary, element("pre", error.traceback));
      return made;
    }));
  }

  async function updateLive() {
    const live = await get(root.dataset.live, {});
    part("notice").textContent = live.notice;
    part("executions").replaceChildren(...live.executions.map(row));
    part("executions").closest("table").hidden = !live.executions.length;
    part("no-executions").hidden = live.executions.length > 0 || Boolean(live.notice);
    showErrors(live.errors);
  }

  async function update() {
    try {
      await Promise.all([updateCurve(), updateLive()]);
    } catch (error) {
      part("notice").textContent = "The server cannot be reached, or you are logged out. Trying again…";
    }
  }

  async function forever() {
    if (!document.hidden) await update();
    setTimeout(forever, curve && curve.behind ? 200 : EVERY);
  }

  by.addEventListener("change", update);
  run.addEventListener("change", () => { location.search = `?run=${run.value}`; }); // downloads and actions follow the run
  new ResizeObserver(() => plot && plot.setSize({ width: chart.clientWidth, height: 320 })).observe(chart);
  new MutationObserver(() => curve && draw()).observe(document.documentElement, { attributes: true, attributeFilter: ["class"] });
  forever();
})();
