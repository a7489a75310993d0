// Motions of several shots over each other, from the first touch of each on; a click, a drag or the slider sets the moment.

const COLOURS = 8, SHOT_DASHES = [[], [7, 3], [2, 3], [9, 3, 2, 3]];
const COMPARED_HEIGHT = 190;
const shown = data.names.map(() => true);
const STEPS = 1000;
const view = { around: data.around !== null, at: 0 };

function shotColour(shot) {
  return colour("shot-" + (shot % COLOURS));
}

function shotDash(shot) {
  return SHOT_DASHES[Math.floor(shot / COLOURS) % SHOT_DASHES.length];
}

// Corners of the marks of the shots, in units of their size: square, diamond, triangles, bow ties, hexagon; the first is
// a disc. Shots of one colour have different marks.
const MARKS = [
  null, [[-1, -1], [1, -1], [1, 1], [-1, 1]], [[0, -1.3], [1.3, 0], [0, 1.3], [-1.3, 0]], [[0, -1.2], [1.2, 1], [-1.2, 1]],
  [[0, 1.2], [1.2, -1], [-1.2, -1]], [[-1.2, -1], [1.2, 1], [1.2, -1], [-1.2, 1]], [[-1, -1.2], [1, 1.2], [-1, 1.2], [1, -1.2]],
  [[-1.2, 0], [-0.6, 1.1], [0.6, 1.1], [1.2, 0], [0.6, -1.1], [-0.6, -1.1]],
];
const MARK_PX = 3.4, MARKS_APART_PX = 26;

function mark(context, shot, x, y) {
  const corners = MARKS[(shot + Math.floor(shot / COLOURS)) % MARKS.length];
  context.fillStyle = shotColour(shot);
  context.strokeStyle = colour("panel");
  context.lineWidth = 1;
  context.beginPath();
  if (corners) corners.forEach(([u, v]) => context.lineTo(x + MARK_PX * u, y + MARK_PX * v));
  else context.arc(x, y, MARK_PX, 0, 2 * Math.PI);
  context.closePath();
  context.stroke();
  context.fill();
}

// Marks on the curves of all shots that are shown, each shot at places of its own: where curves coincide, the marks lie
// side by side along the one that is seen.
function drawMarks(context, panel, x, y, [left, right]) {
  const seen = data.names.map((_, shot) => shot).filter((shot) => shown[shot]);
  if (seen.length < 2) return;
  const apart = Math.max(MARKS_APART_PX, (right - left) / (4 * seen.length));
  drawn[panel.key].marks = [];
  seen.forEach((shot, k) => {
    for (let at = left + (k + 0.5) * apart; at < right; at += seen.length * apart) {
      const place = onCurve(panel.values[shot], data.times[shot], x, at);
      if (place === null) continue;
      mark(context, shot, at, y(place));
      drawn[panel.key].marks.push([shot, at, y(place)]);
    }
  });
}

// The value of a curve at a place between two known neighbours, px; null where there is none.
function onCurve(values, times, x, at) {
  let low = 0, high = times.length - 1;
  if (high < 1 || at < x(times[0]) || at > x(times[high])) return null;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (x(times[middle]) <= at) low = middle; else high = middle;
  }
  const [a, b] = [values[low], values[high]];
  if (a == null || b == null) return null;
  return a + ((at - x(times[low])) / (x(times[high]) - x(times[low]))) * (b - a);
}

// The whole span of the shots that are shown, or that around the contact.
function span() {
  const ends = range(data.times.filter((times, shot) => shown[shot] && times.length));
  const whole = ends || range(data.times) || [0, 1];
  if (!view.around || !data.around) return whole;
  return [Math.max(data.around[0], whole[0]), Math.min(data.around[1], whole[1])];
}

// Limits of a panel in the span: values with bands, which add at most the span of the values on each side.
function comparedLimits(panel, [from, to]) {
  const inside = (shot) => (v, i) => (data.times[shot][i] >= from && data.times[shot][i] <= to ? v : null);
  const each = panel.values.map((values, shot) => (shown[shot] ? values.map(inside(shot)) : []));
  const values = range(each);
  if (!values) return null;
  const bands = range(each.flatMap((list, shot) => [-2, 2].map(
    (n) => list.map((v, i) => (v === null || panel.sd[shot][i] == null ? null : v + n * panel.sd[shot][i])))));
  const size = values[1] - values[0] || Math.abs(values[1]) * 0.01 || 1;
  const [low, high] = bands || values;
  return [Math.max(Math.min(low, values[0]), values[0] - size) - 0.06 * size,
    Math.min(Math.max(high, values[1]), values[1] + size) + 0.06 * size];
}

function makeCompared() {
  const holder = document.getElementById("plots");
  for (const panel of data.panels) {
    const box = document.createElement("div");
    const canvas = document.createElement("canvas");
    canvas.className = "plot";
    canvas.id = "plot-" + panel.key;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${axisLabel(panel)} of all shots against time; click to go there`);
    box.append(canvas);
    holder.append(box);
    const go = (event) => {
      const { left, width, from, to } = drawn[panel.key];
      moveTo(from + ((event.clientX - canvas.getBoundingClientRect().left - left) / width) * (to - from));
    };
    canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); go(event); });
    canvas.addEventListener("pointermove", (event) => { if (event.buttons & 1) go(event); });
  }
}

function moveTo(time) {
  const [from, to] = span();
  view.at = Math.min(Math.max(time, from), to);
  drawAllShots();
}

function drawCompared(panel) {
  const canvas = document.getElementById("plot-" + panel.key);
  const width = widthFor(canvas), height = COMPARED_HEIGHT;
  const context = prepared(canvas, width, height);
  const [from, to] = span();
  const limits = comparedLimits(panel, [from, to]);
  const box = { left: MARGIN.left, right: width - MARGIN.right, top: MARGIN.top, bottom: height - 42 };
  const x = (v) => box.left + ((v - from) / (to - from || 1)) * (box.right - box.left);
  drawn[panel.key] = { left: box.left, width: box.right - box.left, from, to, limits, cursor: x(view.at) };
  comparedAxes(context, panel, box, limits, x, [from, to]);
  if (limits) {
    const y = (v) => box.bottom - ((v - limits[0]) / (limits[1] - limits[0])) * (box.bottom - box.top);
    context.save();
    context.beginPath();
    context.rect(box.left, box.top, box.right - box.left, box.bottom - box.top);
    context.clip();
    panel.values.forEach((_, shot) => shown[shot] && drawShot(context, panel, shot, x, y));
    drawMarks(context, panel, x, y, [box.left, box.right]);
    context.strokeStyle = colour("accent");
    context.lineWidth = 1.2;
    context.beginPath();
    context.moveTo(x(view.at), box.top);
    context.lineTo(x(view.at), box.bottom);
    context.stroke();
    context.restore();
  }
  canvas.dataset.drawn = JSON.stringify(drawn[panel.key]);
}

function comparedAxes(context, panel, box, limits, x, [from, to]) {
  context.strokeStyle = colour("line");
  context.lineWidth = 1;
  context.strokeRect(box.left, box.top, box.right - box.left, box.bottom - box.top);
  context.textBaseline = "middle";
  context.fillStyle = colour("ink");
  context.textAlign = "left";
  context.fillText(axisLabel(panel), 2, 11);
  context.fillStyle = colour("quiet");
  context.textAlign = "right";
  if (!limits) {
    context.textAlign = "center";
    context.fillText("not measured in the shots that are shown", (box.left + box.right) / 2, (box.top + box.bottom) / 2);
    return;
  }
  for (const tick of ticks(...limits, 4)) {
    const at = box.bottom - ((tick - limits[0]) / (limits[1] - limits[0])) * (box.bottom - box.top);
    line(context, box.left, at, box.right, at);
    context.fillText(tickText(tick), box.left - 6, at, box.left - 8);
  }
  context.textAlign = "center";
  context.textBaseline = "top";
  for (const tick of ticks(from, to, Math.max((box.right - box.left) / 90, 4))) {
    line(context, x(tick), box.top, x(tick), box.bottom);
    context.fillText(tickText(tick), x(tick), box.bottom + 11);
  }
  const since = data.contacts.some((contact) => contact) ? "first touch" : "first image";
  context.fillText(`time since the ${since} (ms)`, (box.left + box.right) / 2, box.bottom + 26);
  // Contacts as bars below the plot, one after the other in a place.
  data.contacts.forEach((contact, shot) => {
    if (!contact || !shown[shot]) return;
    const left = Math.max(x(contact[0]), box.left), right = Math.min(x(contact[1]), box.right);
    if (right < left) return;
    context.fillStyle = shotColour(shot);
    context.fillRect(left, box.bottom + 2 + (shot % 3) * 3, Math.max(right - left, 1), 2);
  });
}

function line(context, x0, y0, x1, y1) {
  context.globalAlpha = 0.5;
  context.beginPath();
  context.moveTo(x0, y0);
  context.lineTo(x1, y1);
  context.stroke();
  context.globalAlpha = 1;
}

function drawShot(context, panel, shot, x, y) {
  const values = panel.values[shot], sd = panel.sd[shot], times = data.times[shot];
  context.fillStyle = context.strokeStyle = shotColour(shot);
  for (const [start, stop] of knownRuns(values)) {
    const steps = Array.from({ length: stop - start }, (_, i) => start + i);
    context.globalAlpha = 0.18;
    context.beginPath();
    for (const i of steps) context.lineTo(x(times[i]), y(values[i] + 2 * (sd[i] || 0)));
    for (const i of [...steps].reverse()) context.lineTo(x(times[i]), y(values[i] - 2 * (sd[i] || 0)));
    context.fill();
    context.globalAlpha = 1;
    context.lineWidth = 1.6;
    context.setLineDash(shotDash(shot));
    context.beginPath();
    for (const i of steps) context.lineTo(x(times[i]), y(values[i]));
    context.stroke();
    context.setLineDash([]);
    if (steps.length === 1) context.fillRect(x(times[start]) - 1.5, y(values[start]) - 1.5, 3, 3);
  }
}

// The frame of a shot that is nearest to the moment; -1 where the shot has none.
function nearest(shot) {
  const times = data.times[shot];
  if (times.length < 2) return -1;
  let low = 0, high = times.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= view.at) low = middle; else high = middle;
  }
  const best = view.at - times[low] <= times[high] - view.at ? low : high;
  const spare = 0.51 * (times[high] - times[low]);
  return Math.abs(times[best] - view.at) <= spare ? best : -1;
}

// The moment, and the numbers of all shots in their frames nearest to it.
function writeMoment() {
  const [from, to] = span();
  const slider = document.getElementById("moment");
  slider.value = Math.round(((view.at - from) / (to - from || 1)) * STEPS);
  const text = `${number(view.at, (to - from) / STEPS)} ms`;
  slider.setAttribute("aria-valuetext", text);
  document.getElementById("now").textContent = text;
  const rows = data.names.map((_, shot) => nearest(shot));
  const body = document.querySelector("#values tbody");
  body.replaceChildren(...data.panels.map((panel) => {
    const line = document.createElement("tr");
    const head = document.createElement("th");
    head.scope = "row";
    head.textContent = axisLabel(panel);
    line.append(head, ...rows.map((row, shot) => {
      const cell = document.createElement("td");
      const value = row < 0 ? null : panel.values[shot][row], sd = row < 0 ? null : panel.sd[shot][row];
      cell.dataset.value = `${panel.key} ${shot}`;
      cell.textContent = value == null ? "\u2013" : number(value, sd) + (sd > 0 ? ` \u00b1 ${number(sd, sd)}` : "");
      return cell;
    }));
    return line;
  }));
}

function drawAllShots() {
  document.querySelectorAll("canvas[data-shot]").forEach(drawKey);
  data.panels.forEach(drawCompared);
  writeMoment();
}

// Line and mark of a shot, beside its name.
function drawKey(canvas) {
  const shot = Number(canvas.dataset.shot), context = prepared(canvas, 30, 12);
  context.strokeStyle = shotColour(shot);
  context.lineWidth = 2;
  context.setLineDash(shotDash(shot));
  context.beginPath();
  context.moveTo(0, 6);
  context.lineTo(30, 6);
  context.stroke();
  context.setLineDash([]);
  mark(context, shot, 15, 6);
}

function choose(around) {
  view.around = around;
  document.getElementById("around").setAttribute("aria-pressed", String(around));
  document.getElementById("whole").setAttribute("aria-pressed", String(!around));
  moveTo(view.at);
}

function startComparison() {
  for (const box of document.querySelectorAll("[data-show]")) {
    box.addEventListener("change", () => { shown[Number(box.dataset.show)] = box.checked; moveTo(view.at); });
  }
  document.getElementById("around").disabled = data.around === null;
  document.getElementById("around").addEventListener("click", () => choose(true));
  document.getElementById("whole").addEventListener("click", () => choose(false));
  document.getElementById("moment").addEventListener("input", (event) => {
    const [from, to] = span();
    moveTo(from + (Number(event.target.value) / STEPS) * (to - from));
  });
  makeCompared();
  choose(data.around !== null);
  new ResizeObserver(drawAllShots).observe(document.querySelector("main"));
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAllShots);
  drawForPrint(drawAllShots);
  window.torchsphere = { data, view, drawn, shown, moveTo, span };
}

startComparison();
