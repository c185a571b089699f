"use strict";
// The eye: from where the sky is seen, by mouse, fingers and keys.

const TURN = 12; // degrees a second, of a view that turns by itself

function setFlat(flat) {
  view.flat = flat;
  byId("top").setAttribute("aria-pressed", String(flat));
  byId("space").setAttribute("aria-pressed", String(!flat));
  if (flat) byId("turn").setAttribute("aria-pressed", "false");
}

const isPressed = (button) => button.getAttribute("aria-pressed") == "true";
const toggle = (button) => button.setAttribute("aria-pressed", String(!isPressed(button)));

/** What has passed since the last frame, in seconds: the view in 3-D turns if it is to. */
function turn(passed) {
  if (isPressed(byId("turn"))) view.azimuth += TURN * Math.min(passed, 0.5);
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
byId("turn").addEventListener("click", () => {
  setFlat(false);
  toggle(byId("turn"));
});
byId("returns").addEventListener("click", () => toggle(byId("returns")));
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
  t: () => setFlat(true), d: () => setFlat(false), f: fit, l: () => goLive(), o: () => byId("turn").click(), r: () => byId("returns").click(), s: () => byId("sound").click(),
  "+": () => zoomBy(1.25), "=": () => zoomBy(1.25), "-": () => zoomBy(0.8),
};
addEventListener("keydown", (e) => {
  if (e.ctrlKey || e.metaKey || e.altKey) return;
  const act = KEYS[e.key.toLowerCase()];
  if (act) act();
});
