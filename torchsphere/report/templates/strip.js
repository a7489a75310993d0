// A mark per frame of the recording: its status by colour and by pattern.

const stripCanvas = document.getElementById("strip");
const STRIP_HEIGHT = 22;

// Filled if the frame was measured; otherwise hatched, with a pattern for each status.
function statusMark(context, status, x, width, height) {
  const { colour: paint } = data.statuses[status];
  context.save();
  context.beginPath();
  context.rect(x, 0, width, height);
  context.clip();
  context.fillStyle = paint;
  context.globalAlpha = status === 0 ? 1 : 0.45;
  context.fillRect(x, 0, width, height);
  context.globalAlpha = 1;
  context.strokeStyle = paint;
  context.lineWidth = 2;
  const lean = [0, 0, height, -height, 0, height][status];
  if (status > 0) hatch(context, x, width, height, lean, status === 5);
  context.restore();
}

function hatch(context, x, width, height, lean, crossed) {
  context.beginPath();
  for (let at = Math.floor((x - height) / 6) * 6; at < x + width + height; at += 6) {
    context.moveTo(at, height);
    context.lineTo(at + lean, 0);
    if (crossed) { context.moveTo(at, 0); context.lineTo(at + lean, height); }
  }
  context.stroke();
}

function drawStrip() {
  const width = widthFor(stripCanvas);
  const context = prepared(stripCanvas, width, STRIP_HEIGHT);
  const from = data.where[0], to = data.where[data.where.length - 1];
  const spare = 0.5 * (to - from) / Math.max(data.where.length - 1, 1);
  const scale = { left: 0, width, from: from - spare, to: to + spare };
  const x = (v) => ((v - scale.from) / (scale.to - scale.from)) * width;
  let start = 0;
  for (let i = 1; i <= data.status.length; i++) {
    if (i < data.status.length && data.status[i] === data.status[start]) continue;
    const left = x(data.where[start] - spare), right = i < data.status.length ? x(data.where[i] - spare) : width;
    statusMark(context, data.status[start], left, Math.max(right - left, 2), STRIP_HEIGHT - 4);
    start = i;
  }
  context.fillStyle = colour("ink");
  context.fillRect(x(data.where[row()]) - 1.5, 0, 3, STRIP_HEIGHT);
  drawn.strip = scale;
}

function makeLegend() {
  const legend = document.getElementById("legend");
  legend.replaceChildren();
  data.statuses.forEach((status, i) => {
    if (status.count === 0) return;
    const item = document.createElement("li");
    const swatch = document.createElement("canvas");
    item.append(swatch, `${status.name} (${status.count})${status.meaning ? `: ${status.meaning}` : ""}`);
    legend.append(item);
    statusMark(prepared(swatch, 18, 14), i, 0, 18, 14);
  });
}
