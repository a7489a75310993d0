// The measurement while it runs: new rows are asked for a few times per second, and drawn.

const POLL_MS = 250;
const known = { version: -1, rows: 0 };

async function track() {
  try {
    const begun = await ask("track", choice());
    emptyRows(state.first, state.last);
    Object.assign(known, { version: -1, rows: 0 });
    byId("outcome").hidden = byId("report").hidden = true;
    byId("show-pick").checked = false;
    byId("follow").checked = true;
    state.job = begun.state;
    showJob(begun);
    say("");
    stage.scrollIntoView({ block: "nearest" });
    setTimeout(poll, POLL_MS);
  } catch (error) {
    say(error.message, "bad");
  }
}

async function poll() {
  try {
    const found = await ask(`progress?version=${known.version}&since=${known.rows}`);
    if (found.state === "none") return;
    take(found);
    state.job = found.state;
    showJob(found);
    if (found.state === "running") setTimeout(poll, POLL_MS);
    else finish(found);
  } catch (error) {
    say(error.message, "bad");
  }
}

// Puts rows into the plots: x, y, radius, quaternion (4), turned angles (3), correlation, status.
function take({ version, start, rows, firstFrame }) {
  if (version !== known.version) {
    const last = data.where[data.where.length - 1];
    if (rows.length || known.rows) emptyRows(firstFrame, Math.max(last, firstFrame + rows.length - 1));
  }
  rows.forEach((values, i) => {
    const at = start + i;
    data.position[at] = values.slice(0, 2);
    data.radius[at] = values[2];
    data.quaternion[at] = values.slice(3, 7);
    [values.slice(0, 2), values.slice(7, 10), values.slice(10, 11)].forEach((part, p) => {
      part.forEach((value, k) => { data.panels[p].values[k][at] = value; });
    });
    data.status[at] = values[11];
  });
  known.version = version;
  known.rows = start + rows.length;
  for (const panel of data.panels) panel.limits = limits(panel);
  data.statuses.forEach((status, i) => { status.count = data.status.filter((s) => s === i).length; });
  if (rows.length && state.job === "running" && byId("follow").checked) seek(firstFrame + known.rows - 1);
}

function showJob({ state: job, phase, done, total }) {
  document.body.dataset.job = job;
  const isRunning = job === "running";
  byId("job").hidden = byId("stop").hidden = byId("follow-box").hidden = !isRunning;
  byId("track").hidden = isRunning;
  byId("track").disabled = byId("save").disabled = isRunning || byId("refusal").textContent !== "";
  byId("motion").hidden = false;
  const text = total ? `${phase}: ${done} of ${total} frames` : phase;
  if (isRunning) byId("phase").textContent = text;
  if (total) byId("bar").value = done / total;
  else byId("bar").removeAttribute("value");
  drawMotion();
}

function drawMotion() {
  if (byId("motion").hidden) return;
  makeLegend();
  drawStrip();
  drawPlots();
  showMoment();
  drawStage();
}

function finish(found) {
  if (found.state !== "done") {
    say(found.sentence, "bad");
    byId("show-pick").checked = true;
    drawStage();
    return;
  }
  byId("outcome").hidden = false;
  byId("verdict").textContent = found.verdict;
  byId("verdict").className = `verdict ${found.grade}`;
  byId("outcome-warnings").textContent = found.warnings
    ? `Warnings in the report: ${found.warnings}.` : "";
  byId("report").hidden = !found.hasReport;
  byId("outcome-folder").textContent = `It lies in ${found.folder}. To track again replaces it.`;
  byId("track").textContent = "Track again";
  say(found.verdict, found.grade === "good" ? "good" : "bad");
}

async function stopRun() {
  byId("phase").textContent = "Stopping";
  try {
    await ask("stop", {});
  } catch (error) {
    say(error.message, "bad");
  }
}
