// The ball in three dimensions: its graticule and axes, and the spin as an arrow with the path of its tip. Drawn in the
// camera frame (x right, y down, z away) and rotated by a view. The fixed axes have the names of the results' frame.

const orbitCanvas = document.getElementById("orbit");
const FIRST_VIEW = { yaw: -0.5, pitch: 0.35 };
const view = { ...FIRST_VIEW };
const FIXED = data.lab
  ? [[[1, 0, 0], "x right"], [[0, -1, 0], "y up"], [[0, 0, -1], "z to the camera"]]
  : [[[1, 0, 0], "x right"], [[0, 1, 0], "y down"], [[0, 0, 1], "z away"]];
const FASTEST = Math.max(1e-12, ...data.spin.map((w) => (w[0] === null ? 0 : Math.hypot(...w))));

function viewMatrix() {
  const [c, s, d, t] = [Math.cos(view.yaw), Math.sin(view.yaw), Math.cos(view.pitch), Math.sin(view.pitch)];
  return product([[1, 0, 0], [0, d, -t], [0, t, d]], [[c, 0, s], [0, 1, 0], [-s, 0, c]]);
}

function drawOrbit() {
  const size = Math.min(widthFor(orbitCanvas), 340);
  const context = prepared(orbitCanvas, size, size);
  const v = viewMatrix();
  const radius = 0.27 * size;
  const onScreen = (p) => { const q = turned(v, p); return [size / 2 + radius * q[0], size / 2 + radius * q[1]]; };
  drawn.orbit = { size, radius, view: { ...view }, axes: null, spin: null };
  fixedAxes(context, onScreen);
  context.strokeStyle = colour("quiet");
  context.lineWidth = 1.2;
  context.beginPath();
  context.arc(size / 2, size / 2, radius, 0, 2 * Math.PI);
  context.stroke();
  const m = matrix(data.quaternion[row()]);
  if (m) orbitBall(context, m, v, size, radius, onScreen);
  spinArrow(context, onScreen);
  orbitNote(m);
  orbitCanvas.dataset.drawn = JSON.stringify(drawn.orbit);
}

function fixedAxes(context, onScreen) {
  context.strokeStyle = context.fillStyle = colour("quiet");
  context.lineWidth = 1;
  for (const [direction, name] of FIXED) {
    arrow(context, onScreen([0, 0, 0]), onScreen(direction.map((c) => 1.5 * c)), 6);
    const [x, y] = onScreen(direction.map((c) => 1.68 * c));
    const half = context.measureText(name).width / 2 + 2;
    // Beside the end of the arrow, not over it.
    const aside = x + half * Math.min(Math.max((x - drawn.orbit.size / 2) / 40, -1), 1);
    haloed(context, name, Math.min(Math.max(aside, half), drawn.orbit.size - half), y);
  }
}

function orbitBall(context, m, v, size, radius, onScreen) {
  const seen = product(v, m);
  for (const front of [false, true]) {
    context.strokeStyle = colour("ink");
    context.globalAlpha = front ? 0.55 : 0.13;
    context.lineWidth = 1;
    for (const line of graticule(seen, front)) {
      context.beginPath();
      for (const [x, y] of line) context.lineTo(size / 2 + radius * x, size / 2 + radius * y);
      context.stroke();
    }
  }
  context.globalAlpha = 1;
  drawn.orbit.axes = {};
  AXES.forEach((axis, k) => {
    const direction = turned(m, axis.direction);
    const tip = onScreen(direction.map((c) => 1.25 * c));
    const front = turned(v, direction)[2] < 0;
    context.strokeStyle = context.fillStyle = colour("series-" + [1, 2, 0][k]);
    context.lineWidth = front ? 2.5 : 1.5;
    context.setLineDash(front ? [] : [3, 3]);
    arrow(context, onScreen([0, 0, 0]), tip);
    context.setLineDash([]);
    haloed(context, axis.name + "\u2032", ...besideTip(tip, size / 2));
    drawn.orbit.axes[axis.name] = tip;
  });
}

// A position for the name of an axis of the ball, beside the name of a frame axis in the same direction.
function besideTip([x, y], middle) {
  const length = Math.hypot(x - middle, y - middle) || 1;
  return [x - (13 * (y - middle)) / length, y + (13 * (x - middle)) / length];
}

// Text over lines, with an outline in the colour of the panel.
function haloed(context, text, x, y) {
  context.save();
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.setLineDash([]);
  context.strokeStyle = colour("panel");
  context.lineWidth = 4;
  context.lineJoin = "round";
  context.strokeText(text, x, y);
  context.fillText(text, x, y);
  context.restore();
}

// Spin vectors; the fastest is 1.4 radii long.
function spinArrow(context, onScreen) {
  const length = (w) => w.map((c) => (1.4 * c) / FASTEST);
  context.strokeStyle = context.fillStyle = "#cc79a7";
  context.lineWidth = 1;
  context.beginPath();
  let on = false;
  for (const w of data.spin) {
    if (w[0] !== null) on ? context.lineTo(...onScreen(length(w))) : context.moveTo(...onScreen(length(w)));
    on = w[0] !== null;
  }
  context.stroke();
  const now = data.spin[row()];
  if (now[0] === null) return;
  const tip = onScreen(length(now));
  context.lineWidth = 4;
  arrow(context, onScreen([0, 0, 0]), tip, 12);
  drawn.orbit.spin = tip;
}

function orbitNote(m) {
  const known = data.spin[row()][0] !== null;
  const parts = [];
  if (!m) parts.push("The orientation is not measured at this frame.");
  if (!known) parts.push("The spin is not measured at this frame.");
  parts.push("x\u2032, y\u2032, z\u2032: axes of the ball, those of the first frame turned with it (dashed: behind). Thick arrow: "
    + "spin axis by the right-hand rule; thin line: the path of its tip.");
  const note = document.getElementById("orbit-note");
  note.replaceChildren(parts.join(" "), onScreenOnly(" Drag, or use the arrow keys."));
}

function turnView(yaw, pitch) {
  view.yaw += yaw;
  view.pitch = Math.min(Math.max(view.pitch + pitch, -Math.PI / 2), Math.PI / 2);
  drawOrbit();
}

function makeOrbit() {
  let last = null;
  orbitCanvas.addEventListener("pointerdown", (event) => {
    orbitCanvas.setPointerCapture(event.pointerId);
    last = event;
  });
  orbitCanvas.addEventListener("pointermove", (event) => {
    if (!(event.buttons & 1) || last === null) return;
    turnView(-0.01 * (event.clientX - last.clientX), 0.01 * (event.clientY - last.clientY));
    last = event;
  });
  orbitCanvas.addEventListener("keydown", (event) => {
    const way = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
    if (!way) return;
    event.preventDefault();
    event.stopPropagation();
    turnView(...way);
  });
  const look = (at) => () => { Object.assign(view, at); drawOrbit(); };
  document.getElementById("orbit-reset").addEventListener("click", look(FIRST_VIEW));
  document.getElementById("orbit-camera").addEventListener("click", look({ yaw: 0, pitch: 0 }));
}
