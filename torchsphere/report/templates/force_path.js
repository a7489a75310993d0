// Normal force against penetration: loading, unloading with their bands, and the law of Hertz.

const FORCE_HEIGHT = 240;

function drawForcePath() {
  const path = data.forcePath;
  if (!path) return;
  const canvas = document.getElementById("force-path");
  const width = widthFor(canvas);
  const context = prepared(canvas, width, FORCE_HEIGHT);
  const box = { left: MARGIN.left, right: width - MARGIN.right, top: MARGIN.top, bottom: FORCE_HEIGHT - 40 };
  const edges = path.force.map((f, i) => f + 2 * path.sdForce[i]);
  const [least, deepest] = range([path.depth]), [weakest, strongest] = range([edges, path.force]);
  const from = Math.min(0, least), to = 1.05 * deepest, low = Math.min(0, weakest), high = 1.05 * strongest;
  const x = (v) => box.left + ((v - from) / (to - from)) * (box.right - box.left);
  const y = (v) => box.bottom - ((v - low) / (high - low)) * (box.bottom - box.top);
  forceAxes(context, box, ticks(from, to, 5), ticks(low, high, 5), x, y, path.unit);
  const loading = path.depth.map((_, i) => i).filter((i) => path.loading[i]);
  const unloading = path.depth.map((_, i) => i).filter((i) => !path.loading[i]);
  if (loading.length) unloading.unshift(loading[loading.length - 1]);
  context.save();
  context.beginPath();
  context.rect(box.left, box.top, box.right - box.left, box.bottom - box.top);
  context.clip();
  if (path.law) {
    context.strokeStyle = colour("ink");
    polyline(context, path.law[0].map((d, i) => [x(d), y(path.law[1][i])]), [2, 3]);
  }
  forceBranch(context, path, loading, 0, x, y);
  forceBranch(context, path, unloading, 1, x, y);
  context.restore();
  forceLegend(context, path, box);
}

function polyline(context, points, dash) {
  context.lineWidth = 1.6;
  context.setLineDash(dash);
  context.beginPath();
  for (const [a, b] of points) context.lineTo(a, b);
  context.stroke();
  context.setLineDash([]);
}

function forceBranch(context, path, rows, k, x, y) {
  context.fillStyle = context.strokeStyle = colour("series-" + k);
  context.globalAlpha = 0.22;
  context.beginPath();
  for (const i of rows) context.lineTo(x(path.depth[i]), y(path.force[i] + 2 * path.sdForce[i]));
  for (const i of [...rows].reverse()) context.lineTo(x(path.depth[i]), y(path.force[i] - 2 * path.sdForce[i]));
  context.fill();
  context.globalAlpha = 1;
  const points = rows.map((i) => [x(path.depth[i]), y(path.force[i])]);
  polyline(context, points, DASHES[k]);
  for (const [a, b] of points) context.fillRect(a - 2, b - 2, 4, 4);
}

function forceAxes(context, box, across, up, x, y, unit) {
  context.strokeStyle = colour("line");
  context.fillStyle = colour("quiet");
  context.lineWidth = 1;
  context.strokeRect(box.left, box.top, box.right - box.left, box.bottom - box.top);
  context.textAlign = "right";
  context.textBaseline = "middle";
  for (const tick of up) context.fillText(tickText(tick), box.left - 6, y(tick), box.left - 8);
  context.textAlign = "center";
  context.textBaseline = "top";
  for (const tick of across) context.fillText(tickText(tick), x(tick), box.bottom + 5);
  context.fillText("penetration (mm)", (box.left + box.right) / 2, box.bottom + 21);
  context.fillStyle = colour("ink");
  context.textAlign = "left";
  context.textBaseline = "middle";
  context.fillText(`normal force (${unit})`, 2, 11);
}

function forceLegend(context, path, box) {
  const names = [["loading", "series-0", DASHES[0]], ["unloading", "series-1", DASHES[1]]];
  if (path.law) names.push(["law of Hertz", "ink", [2, 3]]);
  let right = box.right;
  context.textBaseline = "middle";
  context.textAlign = "right";
  for (const [name, paint, dash] of names.reverse()) {
    context.fillStyle = context.strokeStyle = colour(paint);
    context.fillText(name, right, 11);
    right -= context.measureText(name).width + 5;
    polyline(context, [[right - 18, 11], [right, 11]], dash);
    right -= 28;
  }
}
