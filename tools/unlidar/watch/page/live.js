"use strict";
// Takes in what the server tells, and knows for how long it has told nothing more of each thing.

const byId = (id) => document.getElementById(id);
const TAIL = 60, SILENT_LINK = 6, SILENT_TRACK = 10, SILENT_ENGINE = 60;

const live = {
  tracks: new Map(), sensors: new Map(), engines: new Map(), alarms: new Map(),
  heard: new Map(), now: 0, at: 0, crowded: false,
};
let site = { station: "unlidar", heading: null, zones: [], forget_s: 600, most_tracks: 256 };
let heard = 0; // the server, by this page's clock
let offset = Infinity; // of this page's clock to the server's: where a message was least under way
let hushed = new Set();

const keyOf = (thing) => `${thing.station}/${thing.track}`;
/** The station's time when the server spoke last, and what has passed since. */
const now = () => (live.now ? live.now + (performance.now() - heard) / 1000 : 0);
/** Seconds since the server was last told of it. */
const age = (thing) => Math.max(0, performance.now() / 1000 - offset - thing.heard);
const isLinked = () => heard > 0 && performance.now() - heard < 1000 * SILENT_LINK;
/** The rows of a track, which come late, and where it is now. */
const upToNow = ({ rows, position }) => (position?.[T] > rows.at(-1)[T] ? [...rows, position] : rows);
const isUnheard = (track) => age(track) >= SILENT_TRACK;
/** All that have ever said anything; "sky" is no station, but the drones of all. */
const engines = () => [...new Set([...live.engines.keys(), ...live.heard.keys()])].filter((name) => name != "sky");
/** Whether the engine of a station may have ended: nothing of it has come for a minute. */
const isUnknown = (station) => age({ heard: live.heard.get(station) ?? -Infinity }) >= SILENT_ENGINE;

/** As the newest of a map; the oldest go where there are too many. */
function keep(map, key, value, most) {
  map.delete(key);
  map.set(key, value);
  if (map.size > most) map.delete(map.keys().next().value);
}

function trackOf(thing) {
  const key = keyOf(thing);
  const track = live.tracks.get(key) ?? { station: thing.station, track: thing.track, drone: thing.drone ?? null, rows: [] };
  track.heard = thing.heard;
  keep(live.tracks, key, track, site.most_tracks);
  return track;
}

const take = {
  track: (e) => { trackOf(e).drone = e.drone ?? null; },
  row: (e) => {
    const track = trackOf(e);
    if (e.drone !== undefined) track.drone = e.drone;
    const row = [e.timestamp, e.x, e.y, e.z, e.vx, e.vy, e.vz, e.sigma_x, e.sigma_y, e.sigma_z, e.support];
    const newest = track.rows.at(-1)?.[T] ?? -Infinity;
    if (row[T] <= newest - TAIL) track.rows = []; // its clock was set back
    else if (row[T] <= newest) return;
    track.rows.push(row);
    while (track.rows[0][T] < row[T] - TAIL) track.rows.shift();
  },
  now: (e) => {
    trackOf(e).position = [e.timestamp, e.x, e.y, e.z, e.vx, e.vy, e.vz, e.sigma_x, e.sigma_y, e.sigma_z, null];
  },
  end: (e) => {
    live.tracks.delete(keyOf(e));
    for (const [key, alarm] of live.alarms) if (keyOf(alarm) == keyOf(e)) endAlarm(key);
  },
  sensor: (e) => keep(live.sensors, `${e.station}/${e.name}`, e, 1024),
  state: (e) => live.engines.set(e.station, e),
  alarm: (e) => {
    const key = `${keyOf(e)}/${e.zone}`;
    if (e.state == "raised") keep(live.alarms, key, e, site.most_tracks);
    else endAlarm(key);
    loadSpans();
  },
};

function endAlarm(key) {
  live.alarms.delete(key);
  hushed.delete(key);
}

function takeAll(batch) {
  heard = performance.now();
  offset = Math.min(offset, heard / 1000 - batch.clock);
  [live.now, live.at] = [batch.now, batch.at];
  for (const event of batch.events) {
    take[event.event]?.({ ...event, heard: batch.clock - (event.age_s ?? 0) });
  }
}

/** What the server has let go as well, or would have if it were heard. */
function forget() {
  for (const [key, track] of live.tracks) if (age(track) >= site.forget_s) live.tracks.delete(key);
  for (const [key, alarm] of live.alarms) {
    if (age(live.tracks.get(keyOf(alarm)) ?? alarm) >= site.forget_s) endAlarm(key);
  }
}

function connect() {
  const source = new EventSource("live");
  source.addEventListener("begin", (message) => {
    site = JSON.parse(message.data);
    offset = Infinity; // it may be another server's clock
  });
  source.addEventListener("snapshot", (message) => {
    const told = JSON.parse(message.data);
    for (const held of [live.tracks, live.sensors, live.engines, live.alarms]) held.clear();
    for (const track of told.tracks) live.tracks.set(keyOf(track), { ...track, heard: told.clock - track.age_s });
    live.heard = new Map(Object.entries(told.heard).map(([name, seconds]) => [name, told.clock - seconds]));
    live.crowded = told.crowded;
    takeAll(told);
    loadSpans();
    setTimeout(loadSpans, 1200); // what came last is stored by then
  });
  source.addEventListener("message", (message) => {
    const told = JSON.parse(message.data);
    for (const name of told.heard) live.heard.set(name, told.clock);
    takeAll(told);
  });
  source.addEventListener("returns", (message) => takeReturns(JSON.parse(message.data)));
  source.addEventListener("error", () => {
    if (source.readyState == EventSource.CLOSED) setTimeout(connect, 1000);
  });
}

// In words

const seconds = (s) => (s < 60 ? `${Math.floor(s)} s` : s < 3600 ? `${Math.floor(s / 60)} min` : s < 86400 ? `${Math.floor(s / 3600)} h` : `${Math.floor(s / 86400)} days`);
const ago = (s) => (s < 1 ? "now" : `${seconds(s)} ago`);

/** UTC; with its date where that is not today's. */
function clock(time) {
  if (!time || !(Math.abs(time) < 8.64e12)) return "--:--:--";
  const text = new Date(time * 1000).toISOString(), day = text.slice(0, -14);
  return (day == new Date().toISOString().slice(0, 10) ? "" : `${day} `) + text.slice(-13, -5);
}

const stations = () => new Set([...live.tracks.values()].map((track) => track.station));
const labelOf = (track) => (stations().size > 1 ? `${track.station} ${track.track}` : `${track.track}`);
/** A LiDAR's or an engine's name, with its station where there are several. */
const ofStation = (station, name) => (engines().length > 1 ? `${station}: ${name}` : name);

/** Whatever keeps the page from showing all that flies, the worst first. */
function troubles() {
  if (!heard) return [];
  if (!isLinked()) {
    return [`No connection to the server for ${seconds((performance.now() - heard) / 1000)}: what is shown is of before`];
  }
  const found = [];
  const sensors = [...live.sensors.values()];
  for (const station of new Set(sensors.map((sensor) => sensor.station))) {
    const own = sensors.filter((sensor) => sensor.station == station);
    const silent = own.filter((sensor) => sensor.state != "ok");
    if (silent.length == own.length && own.length > 1) found.push(`${ofStation(station, "No LiDAR")} sees anything: nothing that flies is found`);
    for (const sensor of silent) {
      found.push(`${ofStation(station, `LiDAR ${sensor.name}`)} ${sensor.state} since ${clock(sensor.at)}, told ${ago(age(sensor))}`);
    }
    for (const sensor of own) {
      if (sensor.clock == "lost") found.push(`${ofStation(station, `LiDAR ${sensor.name}`)} has lost its time synchronisation, told ${ago(age(sensor))}`);
    }
  }
  for (const station of engines()) {
    if (isUnknown(station)) {
      const since = live.heard.has(station) ? ` for ${seconds(age({ heard: live.heard.get(station) }))}` : "";
      found.push(`${ofStation(station, "Tracking")} unknown: nothing was heard of it${since}`);
    }
  }
  for (const engine of live.engines.values()) {
    if (engine.state == "overloaded") found.push(`${ofStation(engine.station, "Tracking")} overloaded: weak drones may be missed`);
  }
  if (live.crowded) found.push("More tracks than can be shown: some are left out");
  return found;
}

/** Whether a sky without tracks may be a sky in which nothing is seen. */
function isBlind() {
  const sensors = [...live.sensors.values()];
  return !isLinked() || engines().some(isUnknown) || (sensors.length > 0 && sensors.every((sensor) => sensor.state != "ok"));
}
