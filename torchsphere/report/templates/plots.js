// A plot per quantity; a click or a drag goes to its time.

const MARGIN = { left: 58, right: 12, top: 24, bottom: 20 };
const PLOT_HEIGHT = 130;
const DASHES = [[], [6, 3], [2, 3]];

function range(lists) {
  let low = Infinity, high = -Infinity;
  for (const list of lists) {
    for (const v of list) {
      if (v !== null && v < low) low = v;
      if (v !== null && v > high) high = v;
    }
  }
  return low <= high ? [low, high] : null;
}

// Limits of a panel: its values with bands of two standard deviations. Bands add at most the span of the values on each
// side.
function limits(panel) {
  const values = range(panel.values);
  if (!values) return null;
  let [low, high] = values;
  const span = high - low || Math.abs(high) * 0.01 || 1;
  if (panel.sd) {
    const edges = range(panel.values.flatMap((list, k) => [-2, 2].map(
      (n) => list.map((v, i) => (v === null || panel.sd[k][i] === null ? null : v + n * panel.sd[k][i])))));
    if (edges) [low, high] = [Math.max(edges[0], low - span), Math.min(edges[1], high + span)];
  }
  return [low - 0.06 * span, high + 0.06 * span];
}

function ticks(low, high, count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= rough);
  const found = [];
  for (let i = Math.ceil(low / step); i * step <= high + 1e-9 * step; i++) found.push(Number((i * step).toPrecision(12)));
  return found;
}

function tickText(value) {
  return String(value).replace("-", "\u2212");
}

function makePlots() {
  const holder = document.getElementById("plots");
  data.panels.forEach((panel, i) => {
    const canvas = document.createElement("canvas");
    canvas.className = "plot";
    canvas.id = "plot-" + panel.key;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${axisLabel(panel)} against ${axisLabel(data.abscissa)}; click to go there`);
    holder.append(canvas);
    seekByPointer(canvas, () => drawn.plots[panel.key]);
    panel.limits = limits(panel);
    panel.last = i === data.panels.length - 1;
  });
  drawn.plots = {};
}

function axisLabel({ title, unit }) {
  return unit ? `${title} (${unit})` : title;
}

// Press, drag and release in a canvas; its horizontal scale is {left, width, from, to}.
function seekByPointer(canvas, scale) {
  const go = (event) => {
    const { left, width, from, to } = scale();
    const share = (event.clientX - canvas.getBoundingClientRect().left - left) / width;
    seekTo(from + share * (to - from));
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    go(event);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons & 1) go(event);
  });
}

function horizontal(width) {
  const from = data.where[0], to = data.where[data.where.length - 1];
  const spare = 0.5 * (to - from) / Math.max(data.where.length - 1, 1);
  return { left: MARGIN.left, width: width - MARGIN.left - MARGIN.right, from: from - spare, to: to + spare };
}

function drawPlots() {
  for (const panel of data.panels) drawPlot(panel);
}

function drawPlot(panel) {
  const canvas = document.getElementById("plot-" + panel.key);
  const width = widthFor(canvas);
  const deviations = deviationsHeight(panel);
  const height = PLOT_HEIGHT + deviations + (panel.last ? 18 : 0);
  const context = prepared(canvas, width, height);
  const across = horizontal(width);
  const bottom = PLOT_HEIGHT - MARGIN.bottom, floor = bottom + deviations;
  const [low, high] = panel.limits || [-1, 1];
  const x = (v) => across.left + ((v - across.from) / (across.to - across.from)) * across.width;
  const y = (v) => bottom - ((v - low) / (high - low)) * (bottom - MARGIN.top);
  if (panel.limits) shade(context, x, floor);
  grid(context, panel, across, bottom, y);
  if (panel.limits) abscissa(context, panel, across, floor, x);
  else drawWhy(context, panel.why, across, bottom);
  context.save();
  context.beginPath();
  context.rect(across.left, MARGIN.top, across.width, bottom - MARGIN.top);
  context.clip();
  panel.values.forEach((_, k) => drawSeries(context, panel, k, x, y));
  context.restore();
  const below = deviations ? drawDeviations(context, panel, across, bottom, x) : null;
  heading(context, panel, width);
  if (panel.limits) cursor(context, x, floor);
  drawn.plots[panel.key] = { ...across, cursor: x(data.where[row()]), below };
  canvas.dataset.drawn = JSON.stringify(drawn.plots[panel.key]);
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
  for (const tick of ticks(across.from, across.to, Math.max(across.width / 90, 2))) {
    context.fillText(tickText(tick), x(tick), bottom + 5);
  }
  if (panel.last) context.fillText(axisLabel(data.abscissa), across.left + across.width / 2, bottom + 21);
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

function knownRuns(values) {
  const runs = [];
  let start = -1;
  for (let i = 0; i <= values.length; i++) {
    const known = i < values.length && values[i] !== null;
    if (known && start < 0) start = i;
    if (!known && start >= 0) { runs.push([start, i]); start = -1; }
  }
  return runs;
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

function cursor(context, x, bottom) {
  context.strokeStyle = colour("accent");
  context.lineWidth = 1.5;
  context.beginPath();
  context.moveTo(x(data.where[row()]), MARGIN.top - 4);
  context.lineTo(x(data.where[row()]), bottom);
  context.stroke();
}
