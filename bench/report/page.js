"use strict";
// The tables are complete in the page. This script shows those of the chosen metric, mode and accuracy, and draws the charts.

const controls = document.querySelector(".controls");
const all = (selector, where = document) => [...where.querySelectorAll(selector)];
const power = target => Number(target).toExponential();
const targets = [...new Set(all(".matrix thead th[data-accuracy]").map(th => th.dataset.accuracy))];

let data, charts = []; // until `begin` has read them

// What is chosen ------------------------------------------------------------------------------------------------------

function chosen() {
  const form = controls ? new FormData(controls) : new FormData();
  return { metric: form.get("metric"), mode: form.get("mode"), accuracy: targets[form.get("accuracy") ?? 0] };
}

function show() {
  const { metric, mode, accuracy } = chosen();
  for (const part of all("[data-metric]"))
    part.hidden = part.dataset.metric !== metric || (part.dataset.mode ?? mode) !== mode;
  for (const sentence of all(".sentence")) sentence.hidden = sentence.dataset.accuracy !== accuracy;
  for (const cell of all("th[data-accuracy], td[data-accuracy]"))
    cell.classList.toggle("here-column", cell.dataset.accuracy === accuracy);
  if (controls) {
    controls.querySelector("output").textContent = power(accuracy);
    controls.elements.accuracy.ariaValueText = power(accuracy);
  }
}

function remember() {
  const { metric, mode, accuracy } = chosen();
  const query = new URLSearchParams({ metric, mode, accuracy: power(accuracy) });
  try { history.replaceState(null, "", `?${query}${location.hash}`); } catch { /* a page without an address */ }
}

function recall() {
  const query = new URLSearchParams(location.search);
  for (const name of ["metric", "mode"]) {
    const found = controls.querySelector(`[name="${name}"][value="${CSS.escape(query.get(name) ?? "")}"]`);
    if (found) found.checked = true;
  }
  const place = targets.findIndex(target => Number(target) === Number(query.get("accuracy")));
  if (place >= 0) controls.elements.accuracy.value = place;
}

// Charts --------------------------------------------------------------------------------------------------------------

// Labels stand at 1, 2 and 5 times powers of ten only.
const ROUND = "indexof(['1', '2', '5'], format(datum.value, '.0e')[0]) < 0 ? '' : ";
const POWERS = ROUND + "format(datum.value, '.0e')";
const SECONDS = ROUND + "datum.value >= 1 ? format(datum.value, '~g') + ' s' : datum.value >= 1e-3 ? "
  + "format(datum.value * 1e3, '~g') + ' ms' : format(datum.value * 1e6, '~g') + ' \u00b5s'";
const MOST = 1.5; // a run with a larger error is of no use
const DASHES = { steps: [1, 0], tolerances: [8, 3, 2, 3], rival: [4, 3] };

class Chart {
  constructor(place) {
    this.place = place;
    this.name = place.dataset.chart;
    this.source = data.charts[this.name];
    this.shown = new Set(this.source.shown);
    this.against = "time";
    this.visible = false;
    place.innerHTML = '<div class="tools"></div><div class="plot"></div><div class="legend" role="group"></div>';
    [this.tools, this.plot, this.legend] = place.children;
    this.legend.setAttribute("aria-label", "Methods: press to hide or show");
    this.addTools();
  }

  addTools() {
    const button = (text, action) => {
      const made = document.createElement("button");
      made.type = "button";
      made.textContent = text;
      made.onclick = () => { action(made); this.draw(); };
      this.tools.append(made);
      return made;
    };
    const against = ["time", "evaluations"].map(what => button(`against ${what}`, made => {
      this.against = what;
      for (const other of against) other.ariaPressed = other === made;
    }));
    against[0].ariaPressed = true;
    against[1].ariaPressed = false;
    button("all methods", () => { this.shown = new Set(this.methods()); });
    button("the fastest", () => { this.shown = new Set(this.source.shown); });
  }

  // The points of the chosen mode, with an error of the chosen metric.
  points() {
    const { metric, mode } = chosen();
    this.metric = this.source.metrics.includes(metric) ? metric : this.source.metrics[0];
    return this.source.points.map(row => Object.fromEntries(data.columns.map((name, i) => [name, row[i]])))
      .filter(p => (p.mode === mode || p.mode === "") && p.errors[this.metric] > 0 && p.errors[this.metric] < MOST)
      .map(p => ({ ...p, ...data.methods[p.method], error: p.errors[this.metric] }));
  }

  methods() { return [...new Set(this.points().map(p => p.method))]; }

  draw() {
    if (!this.visible) return;
    const points = this.points();
    this.drawLegend(points);
    const shown = points.filter(p => this.shown.has(p.method) && (this.against === "time" || p.evaluations))
      .map(p => ({ ...p, timed: `${time(p.seconds)} (${time(p.low)} to ${time(p.high)})`,
        words: `${p.label}: error ${p.error.toExponential(1)} in ${time(p.seconds)}` }));
    // With `ast` the expressions are interpreted: the policy of the page lets no text become code.
    vegaEmbed(this.plot, this.specification(shown), { actions: false, renderer: "svg", ast: true })
      .then(result => { this.view?.finalize(); this.view = result.view; })
      .catch(console.error);
  }

  // The keys stay the same buttons while the methods stay the same: otherwise the keyboard would lose its place.
  drawLegend(points) {
    const present = new Set(points.map(p => p.method)), methods = Object.keys(data.methods).filter(m => present.has(m));
    if (methods.join() !== [...this.legend.children].map(key => key.dataset.method).join())
      this.legend.replaceChildren(...methods.map(method => this.key(method)));
    for (const key of this.legend.children) key.ariaPressed = this.shown.has(key.dataset.method);
  }

  key(method) {
    const one = data.methods[method], key = document.createElement("button");
    key.type = "button";
    key.dataset.method = method;
    key.innerHTML = badge(one);
    key.querySelector("text").textContent = one.sign;
    key.append(one.label);
    key.onclick = () => { this.shown.has(method) ? this.shown.delete(method) : this.shown.add(method); this.draw(); };
    return key;
  }

  specification(points) {
    const byTime = this.against === "time", isNarrow = this.plot.clientWidth < 500;
    const number = (field, title, format) => ({ field, type: "quantitative", title, format });
    const name = (field, title) => ({ field, type: "nominal", title });
    const tooltip = [
      name("label", "method"), number("setting", "step (s) or tolerance", ".3g"), number("steps", "steps", ",d"),
      number("evaluations", "evaluations", ",d"), name("timed", "time: median (range)"), number("error", "error", ".2e"),
    ];
    const scale = { type: "log", nice: false, padding: isNarrow ? 8 : 14 }, grid = true, labelOverlap = true;
    const x = byTime
      ? { ...number("seconds"), scale, axis: { title: "time in the kernel, median", labelExpr: SECONDS, labelOverlap, grid } }
      : { ...number("evaluations"), scale, axis: { title: "evaluations of the right-hand side", format: "~s", labelOverlap, grid } };
    const y = { ...number("error"), scale,
      axis: { title: this.title(), labelExpr: POWERS, labelOverlap, grid, titleLimit: 380 } };
    // Each method is drawn whole before the next: otherwise the signs of hidden marks would be drawn over other marks.
    const layer = [...new Set(points.map(p => p.method))].map((method, i) => {
      const values = points.filter(p => p.method === method);
      const { color, shape, kind, filled } = data.methods[method], clip = true;
      return { data: { values }, layer: [
        { mark: { type: "line", color, clip, strokeWidth: 1.6, strokeDash: DASHES[kind] }, encoding: { x, y, order: number("setting") } },
        { mark: { type: "point", size: isNarrow ? 90 : 150, shape: data.shapes[shape], stroke: color, clip, opacity: 1, strokeWidth: 1.4,
          fill: filled ? color : "var(--page)" }, encoding: { x, y, tooltip, description: name("words") }, params: i ? [] : this.zoom() },
        { mark: { type: "text", fontSize: isNarrow ? 7.5 : 9, fontWeight: 700, baseline: "middle", dy: 0.5, clip, color: filled ? "#fff" : color },
          encoding: { x, y, tooltip, text: name("sign") } },
      ] };
    });
    if (!this.source.error && points.length)
      layer.push({ data: { values: [{}] }, transform: [{ calculate: "accuracy", as: "error" }], encoding: { y },
        mark: { type: "rule", strokeDash: [2, 4], color: "var(--accent)", clip: true } });
    return {
      $schema: "https://vega.github.io/schema/vega-lite/v6.json",
      description: `${this.source.title}: ${this.title()} against ${this.against} of ${[...new Set(points.map(p => p.label))].join(", ")}`,
      width: "container", height: 380, autosize: { type: "fit", contains: "padding" }, background: null,
      params: [{ name: "accuracy", value: Number(chosen().accuracy) }],
      layer,
      config: {
        font: "system-ui, sans-serif", view: { stroke: "var(--line)" },
        axis: { labelColor: "var(--text)", titleColor: "var(--text)", gridColor: "var(--line)", gridOpacity: 0.5,
          domainColor: "var(--muted)", tickColor: "var(--muted)", labelFontSize: 12, titleFontSize: 12.5, titleFontWeight: 400 },
      },
    };
  }

  title() { return this.source.error ? `error: ${this.source.error}` : `${this.metric} error: ${data.metrics[this.metric]}`; }

  // A finger scrolls the page, so that only a mouse can move and zoom a chart.
  zoom() {
    if (!matchMedia("(pointer: fine)").matches) return [];
    return [{ name: "zoom", bind: "scales", select: { type: "interval", zoom: "wheel![event.ctrlKey || event.metaKey]" } }];
  }
}

function badge({ color, shape, filled }) {
  return `<svg class="badge" viewBox="-1.3 -1.3 2.6 2.6" aria-hidden="true"><path d="${data.shapes[shape]}" stroke="${color}" `
    + `fill="${filled ? color : "none"}"/><text y="0.42" fill="${filled ? "#fff" : color}"></text></svg>`;
}

function time(seconds) {
  const [size, unit] = seconds >= 1 ? [1, "s"] : seconds >= 1e-3 ? [1e-3, "ms"] : [1e-6, "\u00b5s"];
  return `${Number((seconds / size).toPrecision(3))} ${unit}`;
}

// From here on, things happen -----------------------------------------------------------------------------------------

const draw = () => charts.forEach(chart => chart.draw());

if (controls) {
  recall();
  controls.addEventListener("input", event => {
    show();
    remember();
    if (event.target.name === "accuracy")
      for (const { view } of charts) view?.signal("accuracy", Number(chosen().accuracy)).run();
    else draw();
  });
  for (const cell of all(".matrix thead th[data-accuracy]"))
    cell.addEventListener("click", () => {
      controls.elements.accuracy.value = targets.indexOf(cell.dataset.accuracy);
      controls.elements.accuracy.dispatchEvent(new Event("input", { bubbles: true }));
    });
}
for (const { tHead, tBodies } of all(".reach")) { // in the file, their cells would take as much as all charts
  const accuracies = [...tHead.rows[0].cells].map(th => th.dataset.accuracy);
  for (const row of tBodies[0].rows)
    [...row.cells].slice(1).forEach((cell, i) => { cell.dataset.accuracy = accuracies[i + 1]; });
}
show();

// A chart is drawn when it comes near the screen, and all of them before printing.
const near = new IntersectionObserver(entries => {
  for (const { isIntersecting, target } of entries) {
    const chart = charts.find(one => one.place === target);
    if (isIntersecting && !chart.visible) { chart.visible = true; chart.draw(); }
  }
}, { rootMargin: "600px" });
const drawAll = () => { for (const chart of charts) chart.visible = true; draw(); };
addEventListener("beforeprint", drawAll);

const links = new Map(all("nav a").map(link => [link.hash.slice(1), link]));
const reading = new IntersectionObserver(entries => {
  for (const { isIntersecting, target } of entries)
    links.get(target.id)?.classList.toggle("here", isIntersecting);
}, { rootMargin: "-20% 0px -70% 0px" });
all("main > section, header").forEach(part => reading.observe(part));

async function begin() {
  const packed = atob(JSON.parse(document.querySelector("script#data").textContent));
  const stream = new Blob([Uint8Array.from(packed, letter => letter.charCodeAt(0))]).stream();
  data = await new Response(stream.pipeThrough(new DecompressionStream("gzip"))).json();
  charts = all("[data-chart]").map(place => new Chart(place));
  for (const chart of charts) chart.drawLegend(chart.points()); // now, so that a section keeps its place when it is drawn
  charts.forEach(chart => near.observe(chart.place));
}

begin();
