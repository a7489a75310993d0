// Buttons, slider and keys; every change of the frame draws all parts.

const slider = document.getElementById("slider");
const playButton = document.getElementById("play");
const FRAME_MS = 80;
let timer = 0;

function drawAll() {
  drawFrame();
  drawResidual();
  drawStrip();
  drawZoom();
  drawPlots();
  drawForcePath();
  drawOrbit();
  drawNumbers();
  drawMoment();
}

function play(on) {
  state.playing = on;
  clearInterval(timer);
  if (on) {
    if (state.stop === data.shown.length - 1) seek(0);
    timer = setInterval(() => (state.stop < data.shown.length - 1 ? seek(state.stop + 1) : play(false)), FRAME_MS);
  }
  playButton.textContent = on ? "Pause" : "Play";
  playButton.setAttribute("aria-pressed", String(on));
}

function onKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const tag = event.target.tagName;
  const last = data.shown.length - 1;
  const zoom = { "+": () => zoomBy(0.5), "-": () => zoomBy(2), 0: zoomWhole }[event.key];
  if (zoom) {
    event.preventDefault();
    zoom();
    return;
  }
  const goal = {
    ArrowLeft: state.stop - 1, ArrowRight: state.stop + 1, PageUp: state.stop - 10, PageDown: state.stop + 10,
    Home: 0, End: last,
  }[event.key];
  if (goal !== undefined) {
    event.preventDefault();
    play(false);
    seek(goal);
  } else if (event.key === " " && tag !== "BUTTON" && tag !== "SUMMARY" && event.target.type !== "checkbox") {
    event.preventDefault();
    play(!state.playing);
  }
}

function start() {
  slider.max = data.shown.length - 1;
  slider.addEventListener("input", () => { play(false); seek(Number(slider.value)); });
  playButton.addEventListener("click", () => play(!state.playing));
  for (const box of document.querySelectorAll(".overlays input")) box.addEventListener("change", drawFrame);
  document.addEventListener("keydown", onKey);
  for (const label of document.querySelectorAll(".turns")) label.hidden = data.quaternion.every((q) => q[0] === null);
  makeZoom();
  makePlots(zoomTo);
  makeLegend();
  seekByPointer(stripCanvas, () => drawn.strip);
  makeOrbit();
  writeNotes();
  onChange(drawAll);
  drawAll();
  new ResizeObserver(drawAll).observe(document.querySelector("main"));
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll);
  drawForPrint(drawAll);
  window.torchsphere = { data, state, drawn, seek };
}

start();
