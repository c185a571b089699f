"use strict";
// The sky on a canvas: seen from above it is the view in 3-D with the eye straight overhead and infinitely far.

const COLOURS = ["#1f4fd6", "#e08a00", "#8e24aa", "#00838f", "#6d4c41", "#d81b8c", "#5f6b00", "#37474f"];
const DARK = ["#8ab4f8", "#ffb74d", "#ce93d8", "#4dd0e1", "#bcaaa4", "#f48fb1", "#d4e157", "#b0bec5"];
const dark = matchMedia("(prefers-color-scheme: dark)");
const colourOf = (number) => (dark.matches ? DARK : COLOURS)[number % COLOURS.length];
const LEAST_REACH = 20, ELEVATION = 28, FAR = 3.2;
const [T, X, Y, Z, VX, VY, VZ, SX, SY, SZ, SUPPORT] = [...Array(11).keys()];

const view = {
  flat: true, azimuth: -35, elevation: ELEVATION, zoom: 1, centre: [0, 0, 0], moved: [0, 0], reach: 60,
};

function cssColour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

/** Makes a canvas as large as it is shown; its size in CSS pixels, and pixels of the screen in one. */
function sized(canvas) {
  const ratio = Math.min(devicePixelRatio || 1, 2), box = canvas.getBoundingClientRect();
  const width = Math.max(1, Math.round(box.width * ratio)), height = Math.max(1, Math.round(box.height * ratio));
  if (canvas.width != width || canvas.height != height) [canvas.width, canvas.height] = [width, height];
  return [box.width, box.height, ratio];
}

/** An empty canvas whose context counts in CSS pixels. */
function prepared(canvas) {
  const [width, height, ratio] = sized(canvas);
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return [context, width, height];
}

/** Metres to pixels: a function of x, y, z that gives [right, down, scale], or null behind the eye. */
function projector(width, height) {
  const scale = view.zoom * 0.45 * Math.min(width, height) / view.reach;
  const [cx, cy, cz] = view.centre;
  if (view.flat) {
    const [mx, my] = view.moved;
    return (x, y) => [width / 2 + (x - cx - mx) * scale, height / 2 - (y - cy - my) * scale, scale];
  }
  const a = view.azimuth * Math.PI / 180, e = view.elevation * Math.PI / 180;
  const [ca, sa, ce, se] = [Math.cos(a), Math.sin(a), Math.cos(e), Math.sin(e)];
  const away = FAR * view.reach / Math.min(view.zoom, 4);
  return (x, y, z) => {
    const [dx, dy, dz] = [x - cx, y - cy, z - cz];
    const right = dx * ca + dy * sa, ahead = -dx * sa + dy * ca;
    const depth = away + ahead * ce - dz * se, up = dz * ce + ahead * se;
    if (depth < away * 0.05) return null;
    const s = scale * away / depth;
    return [width / 2 + right * s, height / 2 - up * s, s];
  };
}

/** Keeps everything in view: grows at once, shrinks slowly. */
function follow(shown, zones) {
  let reach = LEAST_REACH, top = 0;
  for (const track of shown) {
    for (const row of track.rows) {
      reach = Math.max(reach, Math.hypot(row[X], row[Y]), view.flat ? 0 : row[Z]);
      top = Math.max(top, row[Z]);
    }
  }
  view.centre[2] += 0.05 * (0.4 * top - view.centre[2]); // half the picture is no empty ground
  for (const zone of zones) for (const ring of zone.rings) for (const [x, y] of ring) {
    reach = Math.max(reach, Math.min(Math.hypot(x, y), 300));
  }
  reach *= 1.1;
  view.reach = reach > view.reach ? reach : Math.max(reach, view.reach * 0.995);
}

function niceStep(reach) {
  const power = 10 ** Math.floor(Math.log10(reach / 2));
  return [1, 2, 5, 10].map((n) => n * power).find((step) => reach / step <= 4) || 10 * power;
}

function path(context, project, points) {
  let open = false;
  context.beginPath();
  for (const point of points) {
    const at = project(...point);
    if (at) open ? context.lineTo(at[0], at[1]) : context.moveTo(at[0], at[1]);
    open = Boolean(at);
  }
}

function circle(radius, z, steps = 72) {
  return Array.from({ length: steps + 1 }, (_, i) => {
    const a = 2 * Math.PI * i / steps;
    return [radius * Math.cos(a), radius * Math.sin(a), z];
  });
}

function drawGround(context, project, heading, [width, height]) {
  const step = niceStep(view.reach / view.zoom), far = Math.ceil(view.reach / step);
  context.lineWidth = 1;
  context.strokeStyle = context.fillStyle = cssColour("--line");
  context.font = "12px system-ui, sans-serif";
  const labels = [];
  for (let i = 1; i <= Math.min(far + 1, 12); i++) {
    path(context, project, circle(i * step, 0));
    context.stroke();
    const at = project(0, -i * step, 0);
    if (at && at[1] < height - 4) labels.push([`${i * step} m`, at[0] + 4, at[1] - 4]);
  }
  const long = (far + 0.4) * step;
  for (const [dx, dy] of [[1, 0], [0, 1]]) {
    path(context, project, [[-long * dx, -long * dy, 0], [long * dx, long * dy, 0]]);
    context.stroke();
  }
  context.fillStyle = cssColour("--soft");
  for (const [text, x, y] of labels) context.fillText(text, x, y);
  context.font = "600 13px system-ui, sans-serif";
  const names = heading === null ? [["x", 0], ["y", 90]] : [["N", heading], ["E", heading - 90], ["S", heading - 180], ["W", heading + 90]];
  for (const [name, degrees] of names) {
    const a = degrees * Math.PI / 180, radius = view.flat ? 0.97 * view.reach : 1.05 * view.reach;
    const at = project(radius * Math.cos(a), radius * Math.sin(a), 0);
    if (at) context.fillText(name, at[0] - 4, at[1] + 5);
  }
  const station = project(0, 0, 0);
  if (station) {
    context.fillStyle = cssColour("--ink");
    context.beginPath();
    context.moveTo(station[0], station[1] - 7);
    context.lineTo(station[0] + 6, station[1] + 5);
    context.lineTo(station[0] - 6, station[1] + 5);
    context.fill();
  }
}

function drawZones(context, project, zones, alarmed) {
  for (const zone of zones) {
    const hot = alarmed.has(zone.name);
    context.strokeStyle = context.fillStyle = hot ? cssColour("--red") : cssColour("--soft");
    const heights = view.flat ? [0] : [...new Set([Math.max(zone.low ?? 0, 0), zone.high ?? 0])];
    for (const ring of zone.rings) {
      for (const z of heights) {
        path(context, project, ring.map(([x, y]) => [x, y, z]));
        context.setLineDash([6, 4]);
        context.lineWidth = hot ? 2 : 1.2;
        context.stroke();
        context.setLineDash([]);
      }
      context.globalAlpha = hot ? 0.12 : 0.05;
      path(context, project, ring.map(([x, y]) => [x, y, heights[0]]));
      context.fill();
      context.globalAlpha = 1;
      const at = project(...ring.reduce((a, b) => (b[1] > a[1] ? b : a)), heights.at(-1));
      context.font = "12px system-ui, sans-serif";
      if (at) context.fillText(zone.name, at[0] + 4, at[1] - 5);
    }
  }
}

/** Tail, shadow and height line, two sigmas, course, name; only a trace of one that is no longer heard. */
function drawTrack(context, project, track, label, placed) {
  context.save();
  if (track.unheard) context.filter = "opacity(55%) grayscale(80%)";
  drawHeard(context, project, track, track.unheard ? `${label} no longer heard` : label, placed);
  context.restore();
}

function drawHeard(context, project, track, label, placed) {
  const last = track.rows.at(-1), colour = colourOf(track.track);
  context.strokeStyle = context.fillStyle = colour;
  if (!view.flat) {
    context.globalAlpha = 0.25;
    context.lineWidth = 1;
    path(context, project, track.rows.map((row) => [row[X], row[Y], 0]));
    context.stroke();
    context.setLineDash([3, 3]);
    context.globalAlpha = 0.6;
    path(context, project, [[last[X], last[Y], 0], [last[X], last[Y], last[Z]]]);
    context.stroke();
    context.setLineDash([]);
  }
  context.lineWidth = 2;
  const pieces = 6;
  for (let i = 0; i < pieces; i++) { // older pieces are fainter
    const from = Math.floor(track.rows.length * i / pieces), to = Math.floor(track.rows.length * (i + 1) / pieces) + 1;
    context.globalAlpha = 0.2 + 0.7 * i / (pieces - 1);
    path(context, project, track.rows.slice(from, to).map((row) => [row[X], row[Y], row[Z]]));
    context.stroke();
  }
  context.globalAlpha = 1;
  const at = project(last[X], last[Y], last[Z]);
  if (!at) return;
  const up = view.flat ? last[SY] : last[SZ];
  context.globalAlpha = 0.2;
  context.beginPath();
  context.ellipse(at[0], at[1], Math.max(2 * last[SX] * at[2], 1), Math.max(2 * up * at[2], 1), 0, 0, 2 * Math.PI);
  context.fill();
  context.globalAlpha = 1;
  context.lineWidth = 1;
  context.stroke();
  const ahead = project(last[X] + 2 * last[VX], last[Y] + 2 * last[VY], last[Z] + 2 * last[VZ]);
  if (ahead) {
    context.lineWidth = 1.5;
    context.beginPath();
    context.moveTo(at[0], at[1]);
    context.lineTo(ahead[0], ahead[1]);
    context.stroke();
  }
  context.beginPath();
  context.arc(at[0], at[1], 4.5, 0, 2 * Math.PI);
  context.fill();
  context.strokeStyle = cssColour("--sky");
  context.lineWidth = 1.5;
  context.stroke();
  drawLabel(context, `${label}  ${last[Z].toFixed(0)} m`, at, placed);
}

/** Beside its point; where another label is, further down. */
function drawLabel(context, text, at, placed) {
  context.font = "600 13px system-ui, sans-serif";
  const width = context.measureText(text).width, wide = context.canvas.getBoundingClientRect().width;
  const x = at[0] + 10 + width > wide - 4 ? at[0] - 10 - width : at[0] + 10;
  let y = at[1] - 6;
  for (let tries = 0; tries < 12; tries++) {
    const hit = placed.find(([px, py, pw]) => Math.abs(py - y) < 16 && x < px + pw && px < x + width);
    if (!hit) break;
    y = hit[1] + 16;
  }
  placed.push([x, y, width]);
  context.lineWidth = 3;
  context.strokeStyle = cssColour("--sky");
  context.strokeText(text, x, y);
  context.fillText(text, x, y);
}

function drawSky(canvas, shown, site, alarmedZones, labelOf) {
  const [context, width, height] = prepared(canvas);
  follow(shown, site.zones);
  const project = projector(width, height);
  context.lineJoin = "round";
  drawGround(context, project, site.heading, [width, height]);
  drawZones(context, project, site.zones, alarmedZones);
  const placed = [];
  for (const track of shown) drawTrack(context, project, track, labelOf(track), placed);
}

/** Bars of tracks in lanes, alarms as red marks, the time that is shown. */
function drawStrip(canvas, spans, alarms, begin, end, at) {
  const [context, width, height] = prepared(canvas);
  const where = (time) => (time - begin) / (end - begin) * width;
  const lanes = [];
  for (const [, number, from, to] of spans) {
    if (to < begin || from > end) continue;
    let lane = lanes.findIndex((until) => until <= from);
    if (lane < 0) lane = lanes.length;
    lanes[lane] = to;
    context.fillStyle = number === null ? cssColour("--soft") : colourOf(number); // null: many
    const x = Math.max(0, where(from));
    context.fillRect(x, 6 + (lane % 5) * 8, Math.max(2, Math.min(width, where(to)) - x), 6);
  }
  context.fillStyle = cssColour("--red");
  for (const [, , time] of alarms) if (time >= begin && time <= end) context.fillRect(where(time) - 1, 0, 3, height);
  context.strokeStyle = cssColour("--ink");
  context.lineWidth = 1.5;
  context.beginPath();
  context.moveTo(Math.min(where(at), width - 1), 0);
  context.lineTo(Math.min(where(at), width - 1), height);
  context.stroke();
}
