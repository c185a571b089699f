"use strict";
const page = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);
// Plotly's own button to upload a chart is not for recordings that may be confidential.
const config = {displaylogo: false, responsive: true, plotlyServerURL: "",
  modeBarButtonsToRemove: ["sendChartToCloud", "sendDataToCloud", "select2d", "lasso2d"]};

// Points as the page carries them: x, y, z after each other, in 16-bit multiples of a unit.
function unpack(text) {
  const view = new DataView(bytes(text));
  const values = new Float32Array(view.byteLength / 2);
  for (let i = 0; i < values.length; i++) values[i] = view.getInt16(2 * i, true) * page.moments.unit;
  return values;
}

function bytes(text) {
  return Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
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
// Lines and tubes with their times; all browsers that run Plotly are little-endian.
const courses = page.courses.map((course) => ({...course,
  time: new Float32Array(bytes(course.time)),
  points: new Float32Array(bytes(course.points)),
  faces: course.faces === undefined ? null : new Uint16Array(bytes(course.faces))}));
const lines = courses.filter((course) => course.faces === null);
const tubes = courses.filter((course) => course.faces !== null);
const LONG_S = 120, FIRST_LENGTH_S = 60;
const CORNERS = 8;  // of a ring of a tube
const shown = {begin: 0, end: page.duration};
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

const isShown = (time) => time >= shown.begin && time <= shown.end;

// The points of a line within the window; what lies outside becomes a gap.
function lineWithin({time, points}) {
  const columns = [[], [], []];
  time.forEach((t, i) => {
    const inside = isShown(t);  // false at a gap, whose time is no number
    if (inside || (columns[0].length && columns[0].at(-1) !== null))
      columns.forEach((column, axis) => column.push(inside ? points[3 * i + axis] : null));
  });
  return columns;
}

function facesWithin({time, faces}) {
  const columns = [[], [], []];
  for (let f = 0; f < faces.length; f += 3)
    if ([0, 1, 2].every((k) => isShown(time[Math.floor(faces[f + k] / CORNERS)])))
      columns.forEach((column, k) => column.push(faces[f + k]));
  return columns;
}

// Target returns up to the first moment of the window and from its last one on are left out.
function targetsWithin() {
  const steps = moments.time.map((time, step) => (isShown(time) ? step : -1)).filter((s) => s >= 0);
  if (isWhole() || moments.time.length === 0) return cut(targets, 0, targets.length / 3);
  if (steps.length === 0) return [[], [], []];
  const from = steps[0] > 0 ? moments.targets_end[steps[0] - 1] : moments.targets_begin;
  return cut(targets, from, moments.targets_end[steps.at(-1)]);
}

function drawScene() {
  const figure = page.figures.scene;
  const overall = unpack(moments.overall);
  fill(figure.data[page.traces.overall], cut(overall, 0, overall.length / 3));
  for (const tube of tubes) fill(figure.data[tube.trace], cut(tube.points, 0, tube.points.length / 3));
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
  Plotly.restyle("scene", {"marker.color": [moments.colours[step]]}, page.traces.moment.at(-1));
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
    const step = Number(slider.value);
    const time = moments.time[step];
    if (!isShown(time)) {  // the window goes along
      const length = shown.end - shown.begin;
      const begin = time < shown.begin ? time : time - length;
      showWindow(begin, begin + length);
    }
    showMoment(step);
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

const isWhole = () => shown.begin <= 0 && shown.end >= page.duration;

// Each axis by itself: told of one, Plotly does not always move those that match it.
function timesWithin(plot) {
  const axes = Object.keys(plot.layout).filter((key) => /^xaxis\d*$/.test(key));
  return Object.fromEntries(axes.map((axis) => [`${axis}.range`, [shown.begin, shown.end]]));
}

// What each vertical axis of a plot has to span for the curves within the window.
function heightsWithin(plot) {
  const spans = {};
  plot.calcdata.forEach((points, index) => {
    const name = plot._fullData[index].yaxis.replace("y", "yaxis");
    let [low, high] = spans[name] || [Infinity, -Infinity];
    for (const {x, y} of points)
      if (isShown(x) && Number.isFinite(y)) [low, high] = [Math.min(low, y), Math.max(high, y)];
    spans[name] = [low, high];
  });
  return Object.fromEntries(Object.entries(spans).map(([name, [low, high]]) => {
    if (isWhole() || !(low <= high)) return [`${name}.autorange`, true];
    const margin = 0.06 * (high - low) || 0.5;
    return [`${name}.range`, [low - margin, high + margin]];
  }));
}

// The flight within the window with the station and what is around, as charts.box_of for all of it.
function boxWithin() {
  if (isWhole()) return page.boxes.near;
  const low = [0, 0, 0], high = [0, 0, 0];
  for (const line of lines)
    lineWithin(line).forEach((column, axis) => {
      for (const value of column)
        if (value !== null) [low[axis], high[axis]] = [Math.min(low[axis], value), Math.max(high[axis], value)];
    });
  const span = Math.max(...low.map((v, axis) => high[axis] - v));
  [0, 1, 2].forEach((axis) => {
    const margin = Math.max((axis < 2 ? 0.35 : 0.175) * span, ((axis < 2 ? 16 : 6) - high[axis] + low[axis]) / 2);
    low[axis] -= margin;
    high[axis] += margin;
  });
  const sides = low.map((v, axis) => high[axis] - v);
  const {eye, center} = page.boxes.near.camera;
  const longest = (lengths) => Math.max(...lengths) / Math.cbrt(lengths[0] * lengths[1] * lengths[2]);
  const near = page.boxes.near.low.map((v, axis) => page.boxes.near.high[axis] - v);
  const scale = longest(sides) / longest(near);
  return {low, high, camera: {center, eye: Object.fromEntries(Object.entries(eye).map(([k, v]) => [k, scale * v]))}};
}

// Shows begin .. end, seconds of the recording, in space and in the curves over time.
function showWindow(begin, end) {
  const least = Math.min(1, page.duration);
  shown.begin = Math.max(0, Math.min(begin, page.duration - least));
  shown.end = Math.min(page.duration, Math.max(end, shown.begin + least));
  const [x, y, z] = [0, 1, 2].map((axis) => [targetsWithin(), ...lines.map(lineWithin)].map((c) => c[axis]));
  Plotly.restyle("scene", {x, y, z}, [page.traces.targets, ...lines.map((line) => line.trace)]);
  if (tubes.length) {
    const [i, j, k] = [0, 1, 2].map((corner) => tubes.map(facesWithin).map((c) => c[corner]));
    Plotly.restyle("scene", {i, j, k}, tubes.map((tube) => tube.trace));
  }
  for (const id of plots.filter((id) => page.timed.includes(id)))
    Plotly.relayout(id, {...timesWithin(byId(id)), ...heightsWithin(byId(id))});
  byId("from").value = shown.begin;
  byId("to").value = shown.end;
  const part = shown.end - shown.begin < page.duration ? ` of ${page.duration.toFixed(1)} s` : "";
  byId("span").textContent = `shown: ${shown.begin.toFixed(1)} to ${shown.end.toFixed(1)} s${part}`;
  drawStrip();
}

// A row of bars for each line: when it is there; what lies outside the window is veiled.
function drawStrip() {
  const svg = byId("strip");
  const rows = Math.max(1, lines.length);
  const height = Math.max(3, Math.min(12, 96 / rows));
  const element = (name, attributes) => {
    const made = document.createElementNS(svg.namespaceURI, name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    return made;
  };
  svg.setAttribute("viewBox", `0 0 ${page.duration} ${rows * height + 8}`);
  svg.style.height = `${rows * height + 24}px`;
  const parts = lines.flatMap((line, row) => line.spans.map(([begin, end]) => {
    const bar = element("rect", {x: begin, width: Math.max(end - begin, page.duration / 500),
      y: 4 + row * height, height: 0.7 * height, fill: line.colour});
    bar.append(element("title", {}));
    bar.firstChild.textContent = `${line.name}: ${begin.toFixed(1)} to ${end.toFixed(1)} s`;
    return bar;
  }));
  const veil = (x, width) => element("rect", {x, width, y: 0, height: "100%", fill: "#fff", "fill-opacity": 0.75});
  svg.replaceChildren(...parts, veil(0, shown.begin), veil(shown.end, page.duration - shown.end));
}

function startWindow() {
  if (!(page.duration > 0)) return;
  byId("window").hidden = false;
  const waiting = {at: null};
  const soon = (begin, end) => {
    if (waiting.at === null) requestAnimationFrame(() => {
      const [b, e] = waiting.at;
      waiting.at = null;
      showWindow(b, e);
    });
    waiting.at = [begin, end];
  };
  for (const id of ["from", "to"]) byId(id).max = page.duration;
  byId("from").addEventListener("input", (event) => soon(Number(event.target.value), shown.end));
  byId("to").addEventListener("input", (event) => {
    const end = Number(event.target.value);
    soon(Math.min(shown.begin, end), end);
  });
  // The strip drags the window along, or brings it to where it was pressed.
  const strip = byId("strip");
  const timeAt = (event) => {
    const box = strip.getBoundingClientRect();
    return (event.clientX - box.left) / box.width * page.duration;
  };
  const moveTo = (begin) => {
    const length = shown.end - shown.begin;
    const kept = Math.max(0, Math.min(begin, page.duration - length));
    soon(kept, kept + length);
  };
  let offset = null;
  strip.addEventListener("pointerdown", (event) => {
    const time = timeAt(event);
    offset = isShown(time) ? time - shown.begin : (shown.end - shown.begin) / 2;
    strip.setPointerCapture(event.pointerId);
    moveTo(time - offset);
  });
  strip.addEventListener("pointermove", (event) => { if (offset !== null) moveTo(timeAt(event) - offset); });
  strip.addEventListener("pointerup", () => { offset = null; });
  strip.addEventListener("pointercancel", () => { offset = null; });
  const now = () => (moments.time.length ? moments.time[Number(byId("time").value)] : 0);
  const around = (length) => {
    const begin = Math.max(0, Math.min(now() - length / 2, page.duration - length));
    showWindow(begin, begin + length);
  };
  for (const button of document.querySelectorAll("[data-window]"))
    button.addEventListener("click", () => {
      if (button.dataset.window === "all") showWindow(0, page.duration);
      else around(Number(button.dataset.window));
    });
  // Zooming in a curve chooses the window, too.
  for (const id of plots.filter((id) => page.timed.includes(id)))
    byId(id).on("plotly_relayout", (change) => {
      const axis = Object.keys(change).map((key) => /^(xaxis\d*)\.(range|autorange)/.exec(key)).find(Boolean);
      if (!axis) return;
      if (axis[2] === "autorange") return showWindow(0, page.duration);
      const [begin, end] = change[`${axis[1]}.range`]
        || [change[`${axis[1]}.range[0]`], change[`${axis[1]}.range[1]`]];
      if (Math.abs(begin - shown.begin) + Math.abs(end - shown.end) > 1e-3) showWindow(begin, end);
    });
  // Minutes of flight are a tangle.
  if (page.duration > LONG_S) {
    around(FIRST_LENGTH_S);
    showBox(boxWithin());
  } else showWindow(0, page.duration);
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
startWindow();
byId("near").addEventListener("click", () => showBox(boxWithin()));
byId("wide").addEventListener("click", () => showBox(page.boxes.wide));
