"use strict";
// Takes in what the server tells, keeps the newest minute of each track, and shows it, or an hour ago.

const byId = (id) => document.getElementById(id);
const TAIL = 60, GONE = 3, SILENT_LINK = 6, HISTORY = 120, SPANS_EVERY = 5000;

const live = { tracks: new Map(), sensors: new Map(), engines: new Map(), alarms: new Map(), now: 0, at: 0 };
const past = { at: null, tracks: [], begin: 0, end: 0, asked: 0, playing: false };
const line = { hours: 1, spans: [], alarms: [] };
let site = { station: "unlidar", heading: null, zones: [] };
let heard = 0, hushed = new Set(), frames = 0;

const keyOf = (thing) => `${thing.station}/${thing.track}`;
const stations = () => new Set([...live.tracks.values()].map((track) => track.station));
const labelOf = (track) => (stations().size > 1 ? `${track.station} ${track.track}` : `${track.track}`);
/** The station's time when the server spoke last, and what has passed since. */
const now = () => (live.now ? live.now + (performance.now() - heard) / 1000 : 0);
const clock = (time) => (time ? new Date(time * 1000).toISOString().slice(11, 19) : "--:--:--");

// What comes in

function trackOf(thing) {
  const key = keyOf(thing);
  if (!live.tracks.has(key)) {
    live.tracks.set(key, { station: thing.station, track: thing.track, drone: thing.drone ?? null, rows: [], ended: null });
  }
  return live.tracks.get(key);
}

const take = {
  track: (e) => { trackOf(e).drone = e.drone ?? null; },
  row: (e) => {
    const track = trackOf(e);
    if (e.drone !== undefined) track.drone = e.drone;
    track.ended = null;
    const row = [e.timestamp, e.x, e.y, e.z, e.vx, e.vy, e.vz, e.sigma_x, e.sigma_y, e.sigma_z, e.support];
    if (track.rows.length && track.rows.at(-1)[T] >= row[T]) return;
    track.rows.push(row);
    while (track.rows[0][T] < row[T] - TAIL) track.rows.shift();
  },
  end: (e) => { live.tracks.delete(keyOf(e)); },
  sensor: (e) => live.sensors.set(`${e.station}/${e.name}`, e),
  state: (e) => live.engines.set(e.station, e),
  alarm: (e) => {
    const key = `${keyOf(e)}/${e.zone}`;
    if (e.state == "raised") live.alarms.set(key, e);
    else live.alarms.delete(key), hushed.delete(key);
    loadSpans();
  },
};

function takeAll(batch) {
  [live.now, live.at] = [batch.now, batch.at];
  for (const event of batch.events) take[event.event]?.(event);
  heard = performance.now();
}

function connect() {
  const source = new EventSource("live");
  source.addEventListener("begin", (message) => {
    site = JSON.parse(message.data);
    byId("station").textContent = document.title = `unlidar ${site.station}`;
    setLink(true);
  });
  source.addEventListener("snapshot", (message) => {
    const told = JSON.parse(message.data);
    for (const held of [live.tracks, live.sensors, live.engines, live.alarms]) held.clear();
    for (const track of told.tracks) live.tracks.set(keyOf(track), { ...track, ended: null });
    takeAll(told);
    loadSpans();
    setTimeout(loadSpans, 1200); // what came last is stored by then
  });
  source.addEventListener("message", (message) => takeAll(JSON.parse(message.data)));
  source.addEventListener("error", () => {
    setLink(false);
    if (source.readyState == EventSource.CLOSED) setTimeout(connect, 1000);
  });
}

function setLink(on) {
  const link = byId("link"), text = on ? "connected" : "no connection";
  link.className = `badge ${on ? "on" : "off"}`;
  if (link.textContent != text) link.textContent = text;
}

// What is shown

/** The tracks that are there at the time shown, each with its tail. */
function shown() {
  if (past.at === null) return [...live.tracks.values()].filter((track) => track.rows.length);
  const found = [];
  for (const track of past.tracks) {
    const rows = track.rows.filter((row) => row[T] <= past.at && row[T] > past.at - TAIL);
    const last = track.rows.at(-1)[T];
    if (rows.length && past.at <= last + GONE) found.push({ ...track, rows });
  }
  return found;
}

function setRows(body, rows, fill) {
  while (body.children.length > rows.length) body.lastChild.remove();
  rows.forEach((row, i) => fill(body.children[i] || body.appendChild(document.createElement(body.dataset.of)), row));
}

const setText = (element, text) => { if (element.textContent !== text) element.textContent = text; };

function showTable(tracks) {
  const alarmed = new Set([...live.alarms.values()].map(keyOf));
  setText(byId("count"), String(tracks.length));
  byId("nothing").hidden = tracks.length > 0;
  byId("tracks").dataset.of = "tr";
  setRows(byId("tracks"), tracks, (tr, track) => {
    if (!tr.children.length) {
      for (let i = 0; i < 6; i++) tr.append(document.createElement("td"));
      const mark = document.createElement("span");
      mark.className = "mark";
      tr.children[0].append(mark, document.createElement("span"));
    }
    const last = track.rows.at(-1), hot = past.at === null && alarmed.has(keyOf(track));
    tr.className = hot ? "alarmed" : "";
    tr.dataset.key = keyOf(track);
    tr.querySelector(".mark").style.background = colourOf(track.track);
    const drone = track.drone === null || track.drone === undefined ? "" : ` (${Math.round(100 * track.drone)} %)`;
    setText(tr.querySelector("td span:last-child"), `${labelOf(track)}${drone}${hot ? " alarm" : ""}`);
    const texts = [
      last[Z].toFixed(1), Math.hypot(last[VX], last[VY]).toFixed(1),
      `${last[VZ] < 0 ? "\u2212" : "+"}${Math.abs(last[VZ]).toFixed(1)}`,
      Math.hypot(last[X], last[Y], last[Z]).toFixed(0), Math.hypot(last[SX], last[SY], last[SZ]).toFixed(2),
    ];
    texts.forEach((text, i) => setText(tr.children[i + 1], text));
  });
}

function showHealth() {
  const items = [];
  const several = live.engines.size > 1;
  for (const engine of live.engines.values()) {
    const name = several ? `${engine.station}: tracking` : "Tracking";
    items.push([name, engine.state.replace("_", " "), engine.state == "overloaded" ? "warn" : engine.state == "running" ? "" : "plain"]);
    if (engine.load !== undefined) items.push(["Load", `${Math.round(100 * engine.load)} %`, engine.load > 0.9 ? "warn" : ""]);
    items.push(["Frames", `${engine.frames}, ${engine.dropped} dropped (at ${clock(engine.at)})`, engine.dropped ? "warn" : ""]);
  }
  for (const sensor of live.sensors.values()) {
    const name = several ? `${sensor.station}: ${sensor.name}` : sensor.name;
    items.push([name, sensor.state == "ok" ? "ok" : `${sensor.state} since ${clock(sensor.at)}`, sensor.state == "ok" ? "" : "warn"]);
  }
  if (live.at) items.push(["Newest event", clock(live.at), "plain"]);
  if (!items.length) items.push(["Nothing heard yet", "", "plain"]);
  byId("health").dataset.of = "li";
  setRows(byId("health"), items, (li, [name, value, kind]) => {
    if (!li.children.length) {
      li.append(document.createElement("span"), document.createElement("span"));
      li.lastChild.className = "value";
    }
    li.className = kind;
    setText(li.firstChild, name);
    setText(li.lastChild, value);
  });
}

function showAlarms() {
  const alarms = [...live.alarms.values()];
  byId("alarm_panel").hidden = alarms.length == 0;
  byId("alarms").dataset.of = "li";
  setRows(byId("alarms"), alarms, (li, alarm) =>
    setText(li, `Track ${labelOf(alarm)} in ${alarm.zone} since ${clock(alarm.since)}`));
  byId("hush").hidden = [...live.alarms.keys()].every((key) => hushed.has(key));
}

function describe(tracks) {
  const each = tracks.slice(0, 10).map((track) => {
    const last = track.rows.at(-1);
    return `track ${labelOf(track)} ${Math.hypot(last[X], last[Y]).toFixed(0)} metres away at ${last[Z].toFixed(0)} metres`;
  });
  return tracks.length ? `Sky: ${each.join(", ")}` : "Sky: no track";
}

let described = 0;
function show() {
  const tracks = shown().sort((a, b) => a.track - b.track);
  const zones = new Set(past.at === null ? [...live.alarms.values()].map((alarm) => alarm.zone) : []);
  drawSky(byId("view"), tracks, site, zones, labelOf);
  frames++;
  const time = performance.now();
  if (time - described > 200) { // what is read need not change with every frame
    described = time;
    showTable(tracks);
    showHealth();
    showAlarms();
    byId("view").setAttribute("aria-label", describe(tracks));
    setText(byId("now"), clock(past.at ?? now()));
    setText(byId("mode"), past.at === null ? "live" : "past");
    byId("clock").className = past.at === null ? "" : "back";
    showStrip();
  }
}

function showStrip() {
  const end = now(), begin = end - 3600 * line.hours;
  const open = [...live.tracks.values()].filter((t) => t.rows.length)
    .map((t) => [t.station, t.track, t.rows[0][T], t.rows.at(-1)[T]]);
  drawStrip(byId("strip"), [...line.spans, ...open], line.alarms, begin, end, past.at ?? end);
  setText(byId("begin"), end ? clock(begin) : "");
  if (past.at !== null) {
    const back = byId("back");
    if (document.activeElement !== back || past.playing) back.value = past.at - end;
  }
}

let drawnAt = 0;
function loop(time) {
  requestAnimationFrame(loop);
  if (heard && performance.now() - heard > 1000 * SILENT_LINK) setLink(false);
  else if (heard && byId("link").classList.contains("off") && performance.now() - heard < 1000) setLink(true);
  if (past.playing && past.at !== null) {
    past.at += Math.min((time - drawnAt) / 1000, 0.5);
    loadPast();
    if (past.at >= now()) goLive();
  }
  if (time - drawnAt < 30) return;
  drawnAt = time;
  show();
}

// The past

async function answer(path) {
  try {
    const got = await fetch(path);
    return got.ok ? await got.json() : null;
  } catch {
    return null; // the link says it
  }
}

let spansAsked = 0;
async function loadSpans() {
  if (performance.now() - spansAsked < 500) return;
  spansAsked = performance.now();
  const told = await answer("spans");
  if (told) [line.spans, line.alarms] = [told.spans, told.alarms];
}

async function loadPast() {
  if (past.at === null || (past.at >= past.begin + TAIL && past.at < past.end - 2)) return;
  if (performance.now() - past.asked < 100) return;
  past.asked = performance.now();
  const [since, until] = [past.at - TAIL - 5, past.at + HISTORY];
  const told = await answer(`history?since=${since.toFixed(3)}&until=${until.toFixed(3)}`);
  if (told) [past.tracks, past.begin, past.end] = [told.tracks, since, until];
}

function goTo(time) {
  past.at = time;
  byId("live").setAttribute("aria-pressed", "false");
  byId("play").disabled = false;
  const back = byId("back");
  back.setAttribute("aria-valuetext", `${clock(time)} UTC`);
  loadPast();
}

function goLive() {
  [past.at, past.playing, past.begin, past.end, past.tracks] = [null, false, 0, 0, []];
  byId("live").setAttribute("aria-pressed", "true");
  byId("play").disabled = true;
  byId("play").textContent = "Play";
  byId("back").value = 0;
  byId("back").setAttribute("aria-valuetext", "now");
}

byId("back").addEventListener("input", () => {
  const back = Number(byId("back").value);
  back >= 0 ? goLive() : goTo(now() + back);
});
byId("live").addEventListener("click", goLive);
byId("play").addEventListener("click", () => {
  past.playing = !past.playing;
  byId("play").textContent = past.playing ? "Pause" : "Play";
});
for (const button of document.querySelectorAll("[data-hours]")) {
  button.addEventListener("click", () => {
    line.hours = Number(button.dataset.hours);
    byId("back").min = -3600 * line.hours;
    for (const other of document.querySelectorAll("[data-hours]")) other.setAttribute("aria-pressed", String(other == button));
    if (past.at !== null) byId("back").value = past.at - now();
    loadSpans();
  });
}
setInterval(() => { if (!document.hidden) loadSpans(), loadPast(); }, SPANS_EVERY);

// The eye

function setFlat(flat) {
  view.flat = flat;
  byId("top").setAttribute("aria-pressed", String(flat));
  byId("space").setAttribute("aria-pressed", String(!flat));
}

function fit() {
  Object.assign(view, { zoom: 1, moved: [0, 0], azimuth: -35, elevation: ELEVATION, reach: LEAST_REACH });
}

const zoomBy = (factor) => { view.zoom = Math.min(50, Math.max(0.2, view.zoom * factor)); };

/** By pixels: the view from above is moved, the one in 3-D turned. */
function drag(dx, dy) {
  const box = byId("view").getBoundingClientRect();
  if (view.flat) {
    const scale = view.zoom * 0.45 * Math.min(box.width, box.height) / view.reach;
    view.moved = [view.moved[0] - dx / scale, view.moved[1] + dy / scale];
  } else {
    view.azimuth -= dx * 0.4;
    view.elevation = Math.min(88, Math.max(2, view.elevation + dy * 0.3));
  }
}

byId("top").addEventListener("click", () => setFlat(true));
byId("space").addEventListener("click", () => setFlat(false));
byId("fit").addEventListener("click", fit);
byId("closer").addEventListener("click", () => zoomBy(1.25));
byId("farther").addEventListener("click", () => zoomBy(0.8));
const canvas = byId("view"), fingers = new Map();
canvas.addEventListener("pointerdown", (e) => {
  canvas.setPointerCapture(e.pointerId);
  fingers.set(e.pointerId, [e.clientX, e.clientY]);
});
canvas.addEventListener("pointermove", (e) => {
  const before = fingers.get(e.pointerId);
  if (!before) return;
  const spread = () => {
    const [a, b] = [...fingers.values()];
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  };
  const wide = fingers.size == 2 ? spread() : 0;
  fingers.set(e.pointerId, [e.clientX, e.clientY]);
  if (fingers.size == 2) zoomBy(spread() / Math.max(wide, 1));
  else drag(e.clientX - before[0], e.clientY - before[1]);
});
for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (e) => fingers.delete(e.pointerId));
canvas.addEventListener("wheel", (e) => {
  e.preventDefault();
  zoomBy(Math.exp(-e.deltaY * 0.0015));
}, { passive: false });
const ARROWS = { ArrowLeft: [25, 0], ArrowRight: [-25, 0], ArrowUp: [0, 25], ArrowDown: [0, -25] };
canvas.addEventListener("keydown", (e) => {
  if (!ARROWS[e.key]) return;
  e.preventDefault();
  drag(...ARROWS[e.key]);
});
const KEYS = {
  t: () => setFlat(true), d: () => setFlat(false), f: fit, l: goLive, s: () => byId("sound").click(),
  "+": () => zoomBy(1.25), "=": () => zoomBy(1.25), "-": () => zoomBy(0.8),
};
addEventListener("keydown", (e) => {
  if (e.ctrlKey || e.metaKey || e.altKey) return;
  const act = KEYS[e.key.toLowerCase()];
  if (act) act();
});

// The ear: browsers give sound only to pages that were touched

let audio = null;
byId("sound").addEventListener("click", () => {
  const on = byId("sound").getAttribute("aria-pressed") != "true";
  byId("sound").setAttribute("aria-pressed", String(on));
  byId("sound").textContent = on ? "Sound on" : "Sound off";
  if (!on) return;
  audio = audio || new AudioContext();
  audio.resume();
  tone(660, 0.12);
});
byId("hush").addEventListener("click", () => { hushed = new Set(live.alarms.keys()); });

function tone(frequency, seconds) {
  const source = audio.createOscillator(), volume = audio.createGain();
  source.frequency.value = frequency;
  volume.gain.setValueAtTime(0.2, audio.currentTime);
  volume.gain.exponentialRampToValueAtTime(0.001, audio.currentTime + seconds);
  source.connect(volume).connect(audio.destination);
  source.start();
  source.stop(audio.currentTime + seconds);
  tones++;
}
let tones = 0;

setInterval(() => {
  const loud = byId("sound").getAttribute("aria-pressed") == "true";
  if (!loud || ![...live.alarms.keys()].some((key) => !hushed.has(key))) return;
  tone(880, 0.35);
  setTimeout(() => tone(660, 0.35), 380);
}, 1500);

connect();
requestAnimationFrame(loop);
