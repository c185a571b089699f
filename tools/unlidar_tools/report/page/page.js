"use strict";
const page = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);
// Plotly's own button to upload a chart is not for recordings that may be confidential.
const config = {displaylogo: false, responsive: true, plotlyServerURL: "",
  modeBarButtonsToRemove: ["sendChartToCloud", "sendDataToCloud", "select2d", "lasso2d"]};

// Points as the page carries them: x, y, z after each other, in 16-bit multiples of a unit.
function unpack(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const view = new DataView(bytes.buffer);
  const values = new Float32Array(bytes.length / 2);
  for (let i = 0; i < values.length; i++) values[i] = view.getInt16(2 * i, true) * page.moments.unit;
  return values;
}

// Columns x, y, z of the points begin .. end.
function cut(values, begin, end) {
  const columns = [0, 1, 2].map(() => new Float32Array(end - begin));
  for (let i = begin; i < end; i++)
    for (let axis = 0; axis < 3; axis++) columns[axis][i - begin] = values[3 * i + axis];
  return columns;
}

function fill(trace, columns) {
  [trace.x, trace.y, trace.z] = columns;
}

const narrow = window.matchMedia("(max-width: 720px)").matches;
const moments = page.moments;
const steps = unpack(moments.steps);
const targets = unpack(moments.targets);
const plots = [];

function momentOf(step) {
  const from = (ends, first) => (step > 0 ? ends[step - 1] : first);
  const columns = (points) => [0, 1, 2].map((axis) => points.map((p) => p[axis]));
  return [
    cut(steps, from(moments.steps_end, 0), moments.steps_end[step]),
    cut(targets, from(moments.targets_end, moments.targets_begin), moments.targets_end[step]),
    columns(moments.truth[step]),
    columns(moments.estimate[step]),
  ];
}

// Upright windows see less to the sides.
function fromAfar(camera) {
  const eye = Object.fromEntries(Object.entries(camera.eye).map(([k, v]) => [k, narrow ? 1.35 * v : v]));
  return {...camera, eye};
}

function drawScene() {
  const figure = page.figures.scene;
  const overall = unpack(moments.overall);
  fill(figure.data[page.traces.overall], cut(overall, 0, overall.length / 3));
  fill(figure.data[page.traces.targets], cut(targets, 0, targets.length / 3));
  if (narrow) figure.layout.font.size = 11;
  figure.layout.scene.camera = fromAfar(figure.layout.scene.camera);
  Plotly.newPlot("scene", figure.data, figure.layout, config);
}

function drawFlat(id) {
  if (!byId(id)) return;
  const {data, layout} = page.figures[id];
  if (narrow) {
    layout.font.size = 11;
    layout.margin.l = 48;
  }
  // Its buttons would lie over the legend of a narrow plot.
  Plotly.newPlot(id, data, layout, {...config, displayModeBar: narrow ? false : "hover"});
  plots.push(id);
}

function showMoment(step) {
  const [returns, target, truth, estimate] = momentOf(step);
  const clouds = [returns, target, truth, estimate];
  Plotly.restyle("scene", {
    x: clouds.map((c) => c[0]), y: clouds.map((c) => c[1]), z: clouds.map((c) => c[2]),
  }, page.traces.moment);
  const time = moments.time[step];
  byId("now").textContent = time.toFixed(2) + " s";
  for (const id of plots.filter((id) => page.timed.includes(id)))
    Plotly.relayout(id, {shapes: [{type: "line", xref: "x", yref: "paper", x0: time, x1: time,
      y0: 0, y1: 1, line: {color: "#5f6368", width: 1, dash: "dot"}}]});
}

function startSlider() {
  if (moments.time.length === 0) return;
  const slider = byId("time");
  slider.max = moments.time.length - 1;
  byId("slider").hidden = false;
  let waiting = false;
  const update = () => {
    waiting = false;
    showMoment(Number(slider.value));
  };
  slider.addEventListener("input", () => {
    if (!waiting) requestAnimationFrame(update);
    waiting = true;
  });
  let timer = null;
  const stop = () => {
    clearInterval(timer);
    timer = null;
    byId("play").textContent = "Play";
  };
  byId("play").addEventListener("click", () => {
    if (timer !== null) return stop();
    if (slider.value === slider.max) slider.value = 0;
    byId("play").textContent = "Pause";
    timer = setInterval(() => {
      if (slider.value === slider.max) return stop();
      slider.value = Number(slider.value) + 1;
      slider.dispatchEvent(new Event("input"));
    }, 100);
  });
  slider.value = page.first_step;
  showMoment(page.first_step);
}

function showBox(box) {
  const change = {"scene.camera": fromAfar(box.camera)};
  ["x", "y", "z"].forEach((axis, i) => {
    change[`scene.${axis}axis.range`] = [box.low[i], box.high[i]];
  });
  Plotly.relayout("scene", change);
}

// The rows of the table of clusters, the first ones of the chosen order.
function startTable() {
  const body = byId("cluster_rows");
  if (!body) return;
  const heads = [...document.querySelectorAll("th[data-column]")];
  const show = (rows) => {
    body.replaceChildren(...rows.slice(0, page.clusters.shown).map((row) => {
      const line = document.createElement("tr");
      for (const value of row) line.insertCell().textContent = value;
      return line;
    }));
  };
  const sortBy = (head) => {
    const column = Number(head.dataset.column);
    const order = head.getAttribute("aria-sort") === "ascending" ? "descending" : "ascending";
    heads.forEach((h) => h.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", order);
    const sign = order === "ascending" ? 1 : -1;
    // What is no number (inf, nan or empty) stays last.
    const key = (row) => (row[column] === "" || isNaN(row[column]) ? sign * Infinity : Number(row[column]));
    show([...page.clusters.rows].sort((a, b) => sign * (key(a) < key(b) ? -1 : key(a) > key(b) ? 1 : 0)));
  };
  for (const head of heads) {
    head.addEventListener("click", () => sortBy(head));
    head.addEventListener("keydown", (event) => { if (event.key === "Enter") sortBy(head); });
  }
  show(page.clusters.rows);
}

startTable();
drawScene();
["over_time", "error_over_time", "error_histogram"].forEach(drawFlat);
startSlider();
byId("near").addEventListener("click", () => showBox(page.boxes.near));
byId("wide").addEventListener("click", () => showBox(page.boxes.wide));
