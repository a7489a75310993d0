// A plot per quantity; a click or a drag goes to its time.

const PLOT_HEIGHT = 130;
const DASHES = [[], [6, 3], [2, 3]];

// The part of the abscissa that the plots show.
function wholeRange() {
  const from = data.where[0], to = data.where[data.where.length - 1];
  const spare = 0.5 * (to - from) / Math.max(data.where.length - 1, 1);
  return [from - spare, to + spare];
}

function shownRange() {
  return state.range || wholeRange();
}

// Limits of a panel: its values in the range that is shown, with bands of two standard deviations. Bands add at most the
// span of the values on each side.
function limits(panel) {
  if (!range(panel.values)) return null;
  const [from, to] = shownRange();
  const inView = (list) => list.map((v, i) => (data.where[i] >= from && data.where[i] <= to ? v : null));
  const values = range(panel.values.map(inView));
  // A gap in the values has the limits of the whole.
  if (!values) return panel.limits || [-1, 1];
  let [low, high] = values;
  const span = high - low || Math.abs(high) * 0.01 || 1;
  if (panel.sd) {
    const edges = range(panel.values.flatMap((list, k) => [-2, 2].map((n) => inView(
      list.map((v, i) => (v === null || panel.sd[k][i] === null ? null : v + n * panel.sd[k][i]))))));
    if (edges) [low, high] = [Math.max(edges[0], low - span), Math.min(edges[1], high + span)];
  }
  return [low - 0.06 * span, high + 0.06 * span];
}

// `select` takes the range of a drag with Shift.
function makePlots(select) {
  const holder = document.getElementById("plots");
  for (const panel of data.panels) {
    // The page of `pick` replaces the panels when a measurement begins.
    const present = () => data.panels.find(({ key }) => key === panel.key);
    const canvas = document.createElement("canvas");
    canvas.className = "plot";
    canvas.id = "plot-" + panel.key;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${axisLabel(panel)} against ${axisLabel(data.abscissa)}; click to go there`);
    holder.append(canvas);
    seekByPointer(canvas, () => drawn.plots[panel.key], select);
    canvas.addEventListener("pointermove", (event) => showTip(present(), canvas, event));
    canvas.addEventListener("pointerdown", (event) => showTip(present(), canvas, event));
    canvas.addEventListener("pointerleave", hideTip);
  }
  drawn.plots = {};
}

// Press, drag and release in a canvas; its horizontal scale is {left, width, from, to}. A drag with Shift selects a range.
function seekByPointer(canvas, scale, select) {
  let start = null;
  const at = (event) => {
    const { left, width, from, to } = scale();
    return from + ((event.clientX - canvas.getBoundingClientRect().left - left) / width) * (to - from);
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    if (event.shiftKey && select) start = at(event);
    else seekTo(at(event));
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!(event.buttons & 1)) return;
    if (start === null) seekTo(at(event));
    else { state.selected = [start, at(event)].sort((a, b) => a - b); drawPlots(); }
  });
  canvas.addEventListener("pointerup", () => {
    const selected = state.selected;
    start = state.selected = null;
    if (selected) select(...selected);
  });
}

function horizontal(width) {
  const [from, to] = shownRange();
  return { left: MARGIN.left, width: width - MARGIN.left - MARGIN.right, from, to };
}

// The last plot names the abscissa.
function isLast(panel) {
  return panel === data.panels[data.panels.length - 1];
}

function drawPlots() {
  for (const panel of data.panels) drawPlot(panel);
}

function drawPlot(panel) {
  const canvas = document.getElementById("plot-" + panel.key);
  panel.limits = limits(panel);
  const width = widthFor(canvas);
  const deviations = deviationsHeight(panel);
  const height = PLOT_HEIGHT + deviations + (isLast(panel) ? 18 : 0);
  const context = prepared(canvas, width, height);
  const across = horizontal(width);
  const bottom = PLOT_HEIGHT - MARGIN.bottom, floor = bottom + deviations;
  const [low, high] = panel.limits || [-1, 1];
  const x = (v) => across.left + ((v - across.from) / (across.to - across.from)) * across.width;
  const y = (v) => bottom - ((v - low) / (high - low)) * (bottom - MARGIN.top);
  if (panel.limits) within(context, across, MARGIN.top, floor, () => shade(context, x, floor));
  grid(context, panel, across, bottom, y);
  if (panel.limits) abscissa(context, panel, across, floor, x);
  else drawWhy(context, panel.why, across, bottom);
  within(context, across, MARGIN.top, bottom, () => {
    drawRaw(context, panel, x, y, bottom);
    panel.values.forEach((_, k) => drawSeries(context, panel, k, x, y));
  });
  const below = deviations ? drawDeviations(context, panel, across, bottom, x) : null;
  heading(context, panel, width);
  if (panel.limits) within(context, across, 0, floor, () => cursors(context, x, floor));
  drawn.plots[panel.key] = { ...across, cursor: x(data.where[row()]), below };
  canvas.dataset.drawn = JSON.stringify(drawn.plots[panel.key]);
}

// Draws within the axes alone: a zoomed plot has more on either side.
function within(context, across, top, bottom, draw) {
  context.save();
  context.beginPath();
  context.rect(across.left, top, across.width, bottom - top);
  context.clip();
  draw();
  context.restore();
}

// Shades the contact, and the frames whose motion was not measured.
function shade(context, x, bottom) {
  const half = 0.5 * (data.where.length > 1 ? data.where[1] - data.where[0] : 1);
  const band = (from, to, paint) => {
    context.fillStyle = paint;
    context.fillRect(x(from), MARGIN.top, Math.max(x(to) - x(from), 1), bottom - MARGIN.top);
  };
  data.status.forEach((status, i) => {
    if (status > 1) band(data.where[i] - half, data.where[i] + half, colour("missing"));
  });
  if (data.contact) band(...data.contact, colour("contact"));
}

function grid(context, panel, across, bottom, y) {
  context.strokeStyle = colour("line");
  context.fillStyle = colour("quiet");
  context.lineWidth = 1;
  context.strokeRect(across.left, MARGIN.top, across.width, bottom - MARGIN.top);
  context.textBaseline = "middle";
  context.textAlign = "right";
  for (const tick of panel.limits ? ticks(...panel.limits, 4) : []) {
    context.globalAlpha = 0.5;
    context.beginPath();
    context.moveTo(across.left, y(tick));
    context.lineTo(across.left + across.width, y(tick));
    context.stroke();
    context.globalAlpha = 1;
    // A long number is condensed to the width of the margin.
    context.fillText(tickText(tick), across.left - 6, y(tick), across.left - 8);
  }
}

function abscissa(context, panel, across, bottom, x) {
  context.fillStyle = colour("quiet");
  context.textAlign = "center";
  context.textBaseline = "top";
  for (const tick of ticks(across.from, across.to, Math.max(across.width / 70, 2))) {
    context.fillText(tickText(tick), x(tick), bottom + 5);
  }
  if (isLast(panel)) context.fillText(axisLabel(data.abscissa), across.left + across.width / 2, bottom + 21);
}

// Raw differences, as grey points below bands and curves.
function drawRaw(context, panel, x, y, bottom) {
  if (!panel.raw) return;
  context.fillStyle = colour("quiet");
  context.globalAlpha = 0.6;
  panel.raw.values.forEach((values) => values.forEach((v, i) => {
    const at = y(v);
    if (v !== null && at >= MARGIN.top && at <= bottom) context.fillRect(x(panel.raw.where[i]) - 1, at - 1, 2, 2);
  }));
  context.globalAlpha = 1;
}

function drawSeries(context, panel, k, x, y) {
  const values = panel.values[k], sd = panel.sd && panel.sd[k];
  const paint = colour("series-" + k);
  for (const [start, stop] of knownRuns(values)) {
    const steps = Array.from({ length: stop - start }, (_, i) => start + i);
    if (sd) {
      context.fillStyle = paint;
      context.globalAlpha = 0.22;
      context.beginPath();
      for (const i of steps) context.lineTo(x(data.where[i]), y(values[i] + 2 * (sd[i] || 0)));
      for (const i of steps.reverse()) context.lineTo(x(data.where[i]), y(values[i] - 2 * (sd[i] || 0)));
      context.fill();
      context.globalAlpha = 1;
      steps.reverse();
    }
    context.strokeStyle = context.fillStyle = paint;
    context.lineWidth = 1.6;
    context.setLineDash(DASHES[k]);
    context.beginPath();
    for (const i of steps) context.lineTo(x(data.where[i]), y(values[i]));
    context.stroke();
    context.setLineDash([]);
    if (steps.length === 1) context.fillRect(x(data.where[start]) - 1.5, y(values[start]) - 1.5, 3, 3);
  }
}

function heading(context, panel, width) {
  context.textBaseline = "middle";
  context.textAlign = "left";
  context.fillStyle = colour("ink");
  context.fillText(axisLabel(panel), 2, 11);
  const known = range(panel.values) !== null;
  let right = width - MARGIN.right;
  context.textAlign = "right";
  for (let k = panel.names.length - 1; k >= 0 && known; k--) {
    context.fillStyle = context.strokeStyle = colour("series-" + k);
    context.fillText(panel.names[k], right, 11);
    right -= context.measureText(panel.names[k]).width + 5;
    context.lineWidth = 2;
    context.setLineDash(DASHES[k]);
    context.beginPath();
    context.moveTo(right - 18, 11);
    context.lineTo(right, 11);
    context.stroke();
    context.setLineDash([]);
    right -= 28;
  }
}

// The frame that is shown, the frame under the pointer, and the range that is being selected.
function cursors(context, x, bottom) {
  context.strokeStyle = context.fillStyle = colour("accent");
  const line = (where) => {
    context.beginPath();
    context.moveTo(x(where), MARGIN.top - 4);
    context.lineTo(x(where), bottom);
    context.stroke();
  };
  context.lineWidth = 1.5;
  line(data.where[row()]);
  context.lineWidth = 1;
  context.setLineDash([2, 2]);
  if (state.hover !== null) line(data.where[state.hover]);
  context.setLineDash([]);
  if (!state.selected) return;
  context.globalAlpha = 0.2;
  context.fillRect(x(state.selected[0]), MARGIN.top, x(state.selected[1]) - x(state.selected[0]), bottom - MARGIN.top);
  context.globalAlpha = 1;
}
