// Mouse and keys.

const FRAME_MS = 80;
const TOOL_NOTES = {
  ignore: "Click the corners of a region that no frame is to use; click the first corner to close it. Drag corners to move them.",
  move: "Drag the image. With the frame in focus, the wheel zooms in every tool.",
};
let drag = null, timer = 0;

function setTool(tool) {
  state.tool = tool;
  stage.dataset.tool = tool;
  document.querySelector(`input[name="tool"][value="${tool}"]`).checked = true;
  showToolNote();
  drawStage();
}

// Within a circle a drag moves it; a new one can be drawn where there is none.
function showToolNote() {
  const circle = state.circle
    ? "Drag the circle by its inside to move it, by its rim to resize it. A drag elsewhere draws a new one, from its middle to its rim."
    : "Drag from the middle of the ball to its rim.";
  byId("tool-note").textContent = state.tool === "circle" ? circle : TOOL_NOTES[state.tool];
}

function seek(frame) {
  const bounded = Math.min(Math.max(Math.round(frame), 0), boot.count - 1);
  if (bounded === state.frame) return;
  state.frame = bounded;
  showMoment();
  drawStage();
  if (!byId("motion").hidden) { drawStrip(); drawPlots(); }
}

// What the plots and the strip of the report call.
function seekTo(where) {
  byId("follow").checked = false;
  seek(where);
}

function showMoment() {
  const at = state.frame - data.where[0];
  const isInside = at >= 0 && at < data.where.length;
  const status = isInside && state.job !== "none" ? `: ${data.statuses[data.status[at]].name}` : "";
  const text = `Frame ${state.frame} of 0 to ${boot.count - 1}${status}`;
  byId("slider").value = state.frame;
  byId("slider").setAttribute("aria-valuetext", text);
  byId("now").textContent = text;
}

function play(on) {
  state.playing = on;
  clearInterval(timer);
  if (on) {
    if (state.frame >= state.last) seek(state.first);
    timer = setInterval(() => (state.frame < state.last ? seek(state.frame + 1) : play(false)), FRAME_MS);
  }
  byId("play").textContent = on ? "Pause" : "Play";
  byId("play").setAttribute("aria-pressed", String(on));
}

function pointer(event) {
  const box = stage.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
}

// What a press of the circle's tool takes hold of.
function gripAt(at) {
  if (!state.circle || !byId("show-pick").checked) return "new";
  const [x, y] = here(state.circle.x, state.circle.y);
  const away = Math.hypot(at[0] - x, at[1] - y), radius = state.circle.radius * view.scale;
  if (Math.abs(away - radius) < GRIP) return "rim";
  return away < radius ? "inside" : "new";
}

function cornerAt(at) {
  const near = ([x, y]) => { const place = here(x, y); return Math.hypot(at[0] - place[0], at[1] - place[1]) < GRIP; };
  for (const region of [...state.regions.filter(Array.isArray), state.corners]) {
    const k = region.findIndex(near);
    if (k >= 0) return { region, k };
  }
  return null;
}

function onDown(event) {
  if (event.button > 1) return;
  const at = pointer(event), [x, y] = there(...at);
  stage.setPointerCapture(event.pointerId);
  play(false);
  const tool = event.button === 1 ? "move" : state.tool;
  drag = { tool, at, from: [x, y], moved: false, before: state.circle && { ...state.circle } };
  if (tool === "circle") drag.grip = gripAt(at);
  if (tool === "ignore") drag.corner = cornerAt(at);
}

function onMove(event) {
  if (!drag) return hover(pointer(event));
  const at = pointer(event), [x, y] = there(...at);
  const way = Math.hypot(at[0] - drag.at[0], at[1] - drag.at[1]);
  if (!drag.moved && drag.tool !== "move" && way < 3) return;
  drag.moved = true;
  if (drag.tool === "move") {
    pan(at[0] - drag.at[0], at[1] - drag.at[1]);
    drag.at = at;
  } else if (drag.tool === "circle") dragCircle(x, y);
  else if (drag.corner) {
    drag.corner.region[drag.corner.k] = [x, y];
    drawStage();
  }
}

function dragCircle(x, y) {
  const { grip, from, before } = drag;
  if (grip === "inside") return draw({ x: before.x + x - from[0], y: before.y + y - from[1], radius: before.radius });
  const [cx, cy] = grip === "rim" ? [before.x, before.y] : from;
  const radius = Math.hypot(x - cx, y - cy);
  if (radius >= 3) draw({ x: cx, y: cy, radius });
}

function onUp() {
  if (!drag) return;
  const { tool, moved, corner, from } = drag;
  drag = null;
  if (tool !== "ignore") return;
  if (moved && corner) return showRegions();
  if (corner && corner.region === state.corners && corner.k === 0 && state.corners.length > 2) return closeRegion();
  if (!corner) addCorner(...from);
}

function hover(at) {
  const cursors = { rim: "nwse-resize", inside: "move", new: "crosshair" };
  stage.style.cursor = state.tool === "circle" ? cursors[gripAt(at)] : state.tool === "ignore" && cornerAt(at) ? "pointer" : "";
}

function onWheel(event) {
  if (document.activeElement !== stage && !event.ctrlKey) return;
  event.preventDefault();
  zoom(Math.exp(-0.002 * event.deltaY), pointer(event));
}

// Shift and an arrow: the circle, the cross-hair or the image moves.
function nudge(dx, dy) {
  const step = Math.min(Math.max(1 / view.scale, 0.05), 2);
  if (state.tool === "move") return pan(-40 * dx, -40 * dy);
  if (state.tool === "circle") {
    const { x, y } = state.circle || { x: boot.width / 2, y: boot.height / 2 };
    return draw({ x: x + step * dx, y: y + step * dy });
  }
  const [x, y] = state.cross || there(view.width / 2, view.height / 2);
  state.cross = [x + 6 * step * dx, y + 6 * step * dy].map((v, k) => Math.min(Math.max(v, -0.5), [boot.width, boot.height][k] - 0.5));
  drawStage();
}

function resize(by) {
  const step = Math.min(Math.max(1 / view.scale, 0.05), 2);
  draw({ radius: Math.max((state.circle ? state.circle.radius : 20) + by * step, 3) });
}

function putCorner(close) {
  if (state.tool !== "ignore") return;
  if (close) return closeRegion();
  if (!state.cross) state.cross = there(view.width / 2, view.height / 2);
  addCorner(...state.cross);
}

const WAYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const FRAME_KEYS = {
  ArrowLeft: () => state.frame - 1, ArrowRight: () => state.frame + 1, PageUp: () => state.frame - 10,
  PageDown: () => state.frame + 10, Home: () => 0, End: () => boot.count - 1,
};
const KEYS = {
  " ": () => play(!state.playing),
  "+": () => zoom(1.25), "=": () => zoom(1.25), "-": () => zoom(0.8), 0: zoomAll, b: zoomBall,
  c: () => setTool("circle"), i: () => setTool("ignore"), m: () => setTool("move"),
  f: fit, ",": () => resize(-1), ".": () => resize(1),
  "[": () => mark("first", state.frame), "]": () => mark("last", state.frame),
  Enter: () => putCorner(false), Backspace: () => dropCorners(false), Escape: () => dropCorners(true),
};

function onKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const target = event.target, isSlider = target.id === "slider";
  const isFrame = target === stage || target === document.body || isSlider;
  const isPressed = ["BUTTON", "SUMMARY", "A"].includes(target.tagName) || target.type === "checkbox";
  if (!isFrame && !(isPressed && !event.shiftKey && ["ArrowLeft", "ArrowRight"].includes(event.key))) return;
  const act = event.shiftKey && WAYS[event.key] && !isSlider ? () => nudge(...WAYS[event.key])
    : FRAME_KEYS[event.key] && !event.shiftKey ? () => { play(false); seekTo(FRAME_KEYS[event.key]()); }
      : event.shiftKey && event.key === "Enter" ? () => putCorner(true)
        : isSlider && event.key !== " " ? null : KEYS[event.key];
  if (!act) return;
  event.preventDefault();
  act();
}
