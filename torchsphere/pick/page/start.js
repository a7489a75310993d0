// Puts everything together.

function drawAll() {
  layOut();
  drawStage();
  drawEdge();
  drawMotion();
}

function makeControls() {
  const on = (id, event, act) => byId(id).addEventListener(event, act);
  byId("slider").max = byId("first").max = byId("last").max = boot.count - 1;
  on("slider", "input", () => { play(false); seekTo(Number(byId("slider").value)); });
  on("play", "click", () => play(!state.playing));
  on("zoom-in", "click", () => zoom(1.25));
  on("zoom-out", "click", () => zoom(0.8));
  on("zoom-all", "click", zoomAll);
  on("zoom-ball", "click", zoomBall);
  on("find", "click", find);
  on("fit", "click", fit);
  on("clear", "click", () => { setCircle(null); find(); });
  on("add-region", "click", () => { state.regions.push(""); showRegions(); byId("regions").lastChild.firstChild.focus(); });
  on("begin", "click", () => mark("first", state.frame));
  on("end", "click", () => mark("last", state.frame));
  for (const which of ["first", "last"]) {
    on(which, "change", () => { if (byId(which).value !== "") mark(which, Number(byId(which).value)); });
  }
  for (const name of ["x", "y", "radius"]) {
    on(`circle-${name}`, "change", () => { if (byId(`circle-${name}`).value !== "") draw({ [name]: Number(byId(`circle-${name}`).value) }); });
  }
  for (const radio of document.querySelectorAll("input[name=tool]")) radio.addEventListener("change", () => setTool(radio.value));
  for (const box of document.querySelectorAll(".overlays input")) box.addEventListener("change", drawStage);
  on("form", "input", changed);
  on("form", "submit", (event) => event.preventDefault());
  on("track", "click", track);
  on("stop", "click", stopRun);
  on("save", "click", save);
}

function makeLevels() {
  const show = () => {
    for (const name of ["black", "white"]) {
      byId(name).value = state.levels[name];
      byId(`${name}-now`).textContent = shortNumber(state.levels[name]);
    }
    drawStage();
  };
  for (const name of ["black", "white"]) {
    [byId(name).min, byId(name).max] = boot.deepest;
    byId(name).addEventListener("input", () => { state.levels[name] = Number(byId(name).value); show(); });
  }
  byId("levels-reset").addEventListener("click", () => { state.levels = { black: boot.black, white: boot.white }; show(); });
  show();
}

function makeStage() {
  stage.addEventListener("pointerdown", onDown);
  stage.addEventListener("pointermove", onMove);
  stage.addEventListener("pointerup", onUp);
  stage.addEventListener("pointercancel", () => { drag = null; });
  stage.addEventListener("wheel", onWheel, { passive: false });
  document.addEventListener("keydown", onKey);
}

// What the command was started with, or what this page, loaded again, had sent.
function restore() {
  const { circle, frames, ignore, fields } = boot.sent || boot;
  [state.first, state.last] = frames;
  state.frame = state.first;
  state.regions = ignore.map(regionOf);
  if (circle) state.circle = { ...circle, origin: "drawn" };
  else if (boot.found) [state.circle, state.others] = [{ ...boot.found, origin: "found" }, boot.found.others];
  for (const [name, value] of Object.entries(fields || {})) {
    const input = byId("form").elements[name];
    if (input && input.type === "checkbox") input.checked = value;
    else if (input) input.value = value;
  }
}

async function start() {
  restore();
  emptyRows(state.first, state.last);
  makePlots();
  seekByPointer(stripCanvas, () => drawn.strip);
  makeControls();
  makeStage();
  layOut();
  makeLevels();
  setTool("circle");
  showMoment();
  showRegions();
  showCircle();
  updateEdge();
  new ResizeObserver(drawAll).observe(document.querySelector("main"));
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll);
  window.torchsphere = { boot, data, state, drawn, seek, view };
  // A page that was loaded again shows the measurement that runs, or its result.
  await poll();
  if (!state.circle && state.job === "none") await find();
}

start();
