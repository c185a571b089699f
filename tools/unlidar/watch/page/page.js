"use strict";
// Shows what is told, now or an hour ago.

const GONE = 3, HISTORY = 120, SPANS_EVERY = 5000;
const past = { at: null, tracks: [], begin: 0, end: 0, asked: 0, playing: false };
const line = { hours: 1, spans: [], alarms: [] };
let frames = 0, tones = 0;

// What is shown

/** The tracks that are there at the time shown, each with its tail. */
function shown() {
  if (past.at === null) {
    forget();
    return [...live.tracks.values()].filter((track) => track.rows.length).map((track) => ({ ...track, rows: upToNow(track), unheard: isUnheard(track) }));
  }
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
  const heardNow = tracks.filter((track) => !track.unheard).length;
  setText(byId("count"), heardNow == tracks.length ? String(heardNow) : `${heardNow}, and ${tracks.length - heardNow} no longer heard`);
  byId("nothing").hidden = tracks.length > 0;
  setText(byId("nothing"), !live.heard.size ? "Nothing heard yet." : past.at === null && isBlind() ? "No track, and nothing can be seen." : "Nothing flies.");
  byId("tracks").dataset.of = "tr";
  setRows(byId("tracks"), tracks, (tr, track) => {
    if (!tr.children.length) {
      for (let i = 0; i < 8; i++) tr.append(document.createElement("td"));
      const mark = document.createElement("span");
      mark.className = "mark";
      tr.children[0].append(mark, document.createElement("span"));
    }
    const last = track.rows.at(-1), hot = past.at === null && alarmed.has(keyOf(track));
    tr.className = `${hot ? "alarmed" : ""} ${track.unheard ? "unheard" : ""}`;
    tr.dataset.key = keyOf(track);
    tr.querySelector(".mark").style.background = colourOf(track.track);
    setText(tr.querySelector("td span:last-child"), `${labelOf(track)}${hot ? " alarm" : ""}`);
    const texts = [
      last[Z].toFixed(1), Math.hypot(last[VX], last[VY]).toFixed(1),
      `${last[VZ] < 0 ? "\u2212" : "+"}${Math.abs(last[VZ]).toFixed(1)}`,
      Math.hypot(last[X], last[Y], last[Z]).toFixed(0), Math.hypot(last[SX], last[SY], last[SZ]).toFixed(2),
      typeof track.drone == "number" ? `${Math.round(100 * track.drone)} %` : "",
      past.at === null ? seconds(age(track)) : "",
    ];
    texts.forEach((text, i) => setText(tr.children[i + 1], text));
  });
}

/** Each with when it was said: an old word is no state. */
function showHealth() {
  const items = [];
  for (const station of engines()) {
    const engine = live.engines.get(station), unknown = !isLinked() || isUnknown(station);
    const state = engine ? engine.state.replace("_", " ") : "state not told";
    const kind = unknown || state == "overloaded" ? "warn" : state == "running" ? "" : "plain";
    const told = engine ? age(engine) : null;
    items.push([ofStation(station, "Tracking"), `${unknown ? "unknown, was " : ""}${state}`, kind, told]);
    if (typeof engine?.load == "number") items.push(["Load", `${Math.round(100 * engine.load)} %`, unknown || engine.load > 0.9 ? "warn" : "", told]);
    if (engine) items.push(["Frames", `${engine.frames}, ${engine.dropped} dropped`, engine.dropped ? "warn" : unknown ? "plain" : "", told]);
    const heardAt = live.heard.get(station);
    if (heardAt !== undefined) items.push([ofStation(station, "Last heard"), "", unknown ? "warn" : "plain", age({ heard: heardAt })]);
  }
  for (const sensor of live.sensors.values()) {
    const unknown = !isLinked() || isUnknown(sensor.station), ok = sensor.state == "ok";
    const state = ok ? `${unknown ? "unknown, was " : ""}ok` : `${sensor.state} since ${clock(sensor.at)}`;
    const isLost = sensor.clock == "lost";
    items.push([ofStation(sensor.station, sensor.name), `${state}${isLost ? ", time not synchronised" : ""}`, ok && !unknown && !isLost ? "" : "warn", age(sensor)]);
  }
  if (live.at) items.push(["Newest event", clock(live.at), "plain", null]);
  if (!items.length) items.push(["Nothing heard yet", "", "plain", null]);
  byId("health").dataset.of = "li";
  setRows(byId("health"), items, (li, [name, value, kind, told]) => {
    if (!li.children.length) {
      for (const part of ["", "value", "age"]) li.append(document.createElement("span")), li.lastChild.className = part;
    }
    li.className = kind;
    [name, value, told === null ? "" : ago(told)].forEach((text, i) => setText(li.children[i], text));
  });
}

function showTroubles() {
  const found = troubles();
  byId("trouble").hidden = found.length == 0;
  byId("troubles").dataset.of = "li";
  setRows(byId("troubles"), found, (li, text) => setText(li, text));
  const link = byId("link"), linked = isLinked();
  link.className = `badge ${linked ? "on" : "off"}`;
  setText(link, linked ? "connected" : heard ? "no connection" : "connecting");
}

const lost = (alarm) => { const track = live.tracks.get(keyOf(alarm)); return !isLinked() || isUnheard(track ?? alarm); };

function showAlarms() {
  const alarms = [...live.alarms.values()].sort((a, b) => lost(a) - lost(b));
  byId("alarm_panel").hidden = alarms.length == 0;
  byId("alarm_panel").className = alarms.every(lost) ? "lost" : "";
  byId("alarms").dataset.of = "li";
  setRows(byId("alarms"), alarms, (li, alarm) => {
    const unheard = lost(alarm) ? `: the track is no longer heard, last ${ago(age(live.tracks.get(keyOf(alarm)) ?? alarm))}` : "";
    li.className = unheard ? "lost" : "";
    setText(li, `Track ${labelOf(alarm)} in ${alarm.zone} since ${clock(alarm.since)}${unheard}`);
  });
  byId("hush").hidden = [...live.alarms.keys()].every((key) => hushed.has(key));
  const station = `unlidar ${site.station}`;
  setText(byId("station"), station);
  const title = alarms.some((alarm) => !lost(alarm)) ? `Alarm: ${station}` : byId("trouble").hidden ? station : `Trouble: ${station}`;
  if (document.title != title) document.title = title;
}

function describe(tracks) {
  const each = tracks.slice(0, 10).map((track) => {
    const last = track.rows.at(-1);
    return `track ${labelOf(track)}${track.unheard ? ", no longer heard," : ""} ${Math.hypot(last[X], last[Y]).toFixed(0)} metres away at ${last[Z].toFixed(0)} metres`;
  });
  return tracks.length ? `Sky: ${each.join(", ")}` : "Sky: no track";
}

let described = 0;
function show() {
  const tracks = shown().sort((a, b) => a.track - b.track);
  const alarms = past.at === null ? [...live.alarms.values()].filter((alarm) => !lost(alarm)) : [];
  const zones = new Set(alarms.map((alarm) => alarm.zone));
  drawSky(byId("view"), tracks, site, zones, labelOf);
  drawReturns(byId("cloud"), past.at === null && isPressed(byId("returns")));
  frames++;
  const time = performance.now();
  if (time - described > 200) { // what is read need not change with every frame
    described = time;
    showTable(tracks);
    showHealth();
    showTroubles();
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
  if (past.playing && past.at !== null) {
    past.at += Math.min((time - drawnAt) / 1000, 0.5);
    loadPast();
    if (past.at >= now()) goLive();
  }
  if (time - drawnAt < 30) return;
  turn((time - drawnAt) / 1000);
  drawnAt = time;
  show();
}

// The past

async function answer(path) {
  let told = null;
  try {
    const got = await fetch(path);
    if (got.ok) told = await got.json();
  } catch {
    // the link says it
  }
  const left_out = told?.left_out ? `${told.left_out} more tracks are left out.` : "";
  setText(byId("past_note"), told ? left_out : "The past cannot be read just now.");
  return told;
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

setInterval(() => {
  const loud = byId("sound").getAttribute("aria-pressed") == "true";
  if (!loud || ![...live.alarms].some(([key, alarm]) => !hushed.has(key) && !lost(alarm))) return;
  tone(880, 0.35);
  setTimeout(() => tone(660, 0.35), 380);
}, 1500);

connect();
requestAnimationFrame(loop);
