"use strict";
// The LiDARs' returns beneath the sky, drawn by WebGL: what came within the last second, fading.

const FADE = 1, MOST_RETURNS = 30000, POINT = 2.5; // seconds, returns at once, pixels of the page
const VERTEX = `
attribute vec3 steps;
uniform mat4 eye;
uniform float step_m, size;
varying float height;
void main() {
  vec3 at = steps * step_m;
  height = at.z;
  gl_Position = eye * vec4(at, 1.0);
  gl_PointSize = size;
}`;
// From grey at the ground by green to orange from 40 m on; both papers bear these.
const FRAGMENT = `
precision mediump float;
uniform float strength;
varying float height;
void main() {
  vec3 green = vec3(0.10, 0.62, 0.58);
  vec3 low = mix(vec3(0.55, 0.58, 0.62), green, clamp(height / 8.0, 0.0, 1.0));
  gl_FragColor = vec4(mix(low, vec3(0.95, 0.42, 0.10), clamp((height - 8.0) / 32.0, 0.0, 1.0)), 1.0) * strength;
}`;
const returns = { gl: null, at: null, clouds: [], taken: 0 };

function shader(gl, type, text) {
  const made = gl.createShader(type);
  gl.shaderSource(made, text);
  gl.compileShader(made);
  return made;
}

/** Without WebGL `gl` stays null, and the sky is all there is. */
function beginReturns() {
  const gl = byId("cloud").getContext("webgl", { antialias: false, depth: false });
  [returns.gl, returns.clouds] = [null, []];
  if (!gl || gl.isContextLost()) return;
  const program = gl.createProgram();
  gl.attachShader(program, shader(gl, gl.VERTEX_SHADER, VERTEX));
  gl.attachShader(program, shader(gl, gl.FRAGMENT_SHADER, FRAGMENT));
  gl.bindAttribLocation(program, 0, "steps");
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) return;
  gl.useProgram(program);
  gl.enableVertexAttribArray(0);
  gl.enable(gl.BLEND);
  gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  const at = {};
  for (const name of ["eye", "size", "step_m", "strength"]) at[name] = gl.getUniformLocation(program, name);
  Object.assign(returns, { gl, at });
}

/** Each an event `returns`; without WebGL it is said that they are not shown. */
function takeReturns(events) {
  byId("returns").hidden = !returns.gl;
  byId("no_returns").hidden = Boolean(returns.gl);
  const { gl, clouds } = returns;
  returns.taken += events.length;
  if (!gl || document.hidden) return;
  for (const event of events) {
    const bytes = Uint8Array.from(atob(event.xyz), (letter) => letter.charCodeAt(0));
    const cloud = { buffer: gl.createBuffer(), count: bytes.length / 6, step: event.step_m, heard: performance.now() };
    gl.bindBuffer(gl.ARRAY_BUFFER, cloud.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, bytes, gl.STATIC_DRAW);
    clouds.push(cloud);
  }
  let kept = clouds.length, room = MOST_RETURNS;
  while (kept > 0 && (room -= clouds[kept - 1].count + 1) >= 0) kept--;
  dropReturns(kept);
}

/** The oldest of them. */
function dropReturns(count) {
  for (const cloud of returns.clouds.splice(0, Math.max(0, count))) returns.gl.deleteBuffer(cloud.buffer);
}

/** What `projector` does, as a matrix whose columns follow each other. */
function projection(width, height) {
  const scale = view.zoom * 0.9 * Math.min(width, height) / view.reach; // to halves of the picture
  const [cx, cy, cz] = view.centre, [sx, sy] = [scale / width, scale / height];
  if (view.flat) {
    const [mx, my] = view.moved;
    return [sx, 0, 0, 0, 0, sy, 0, 0, 0, 0, 0, 0, -(cx + mx) * sx, -(cy + my) * sy, 0, 1];
  }
  const a = view.azimuth * Math.PI / 180, e = view.elevation * Math.PI / 180;
  const [ca, sa, ce, se] = [Math.cos(a), Math.sin(a), Math.cos(e), Math.sin(e)];
  const away = FAR * view.reach / Math.min(view.zoom, 4);
  const right = [ca, sa, 0], up = [-sa * se, ca * se, ce], ahead = [-sa * ce, ca * ce, -se];
  const of = (axis) => axis[0] * cx + axis[1] * cy + axis[2] * cz;
  const columns = [0, 1, 2].map((i) => [right[i] * sx * away, up[i] * sy * away, 0, ahead[i]]);
  return [...columns.flat(), -of(right) * sx * away, -of(up) * sy * away, 0, away - of(ahead)];
}

function drawReturns(canvas, isShown) {
  const { gl, at, clouds } = returns, time = performance.now();
  if (!gl) return;
  dropReturns(clouds.filter((cloud) => time - cloud.heard >= 1000 * FADE).length);
  const [width, height, ratio] = sized(canvas);
  gl.viewport(0, 0, canvas.width, canvas.height);
  gl.clear(gl.COLOR_BUFFER_BIT);
  if (!isShown || !clouds.length) return;
  gl.uniformMatrix4fv(at.eye, false, projection(width, height));
  gl.uniform1f(at.size, POINT * ratio);
  for (const cloud of clouds) {
    gl.bindBuffer(gl.ARRAY_BUFFER, cloud.buffer);
    gl.vertexAttribPointer(0, 3, gl.SHORT, false, 6, 0);
    gl.uniform1f(at.step_m, cloud.step);
    gl.uniform1f(at.strength, 0.9 * (1 - (time - cloud.heard) / (1000 * FADE)));
    gl.drawArrays(gl.POINTS, 0, cloud.count);
  }
}

byId("cloud").addEventListener("webglcontextlost", (e) => { e.preventDefault(), returns.gl = null; });
byId("cloud").addEventListener("webglcontextrestored", beginReturns);
beginReturns();
