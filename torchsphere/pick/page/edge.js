// The edge along the circle, unrolled: a column per ray, from inside (below) to outside (above). A right circle makes
// it a straight line in the middle. Beside it, the mean level at each distance.

const edgeCanvas = byId("edge");
const EDGE_HEIGHT = 150, PROFILE = 78;
let edge = null, edgeAsked = null, edgeBusy = false;

function edgeOf(circle) {
  return `edge?x=${circle.x}&y=${circle.y}&radius=${circle.radius}&frame=${circle.frame}`;
}

// Asks for the edge of the circle; while an answer is awaited, only the latest question counts.
async function updateEdge() {
  edgeAsked = state.circle && { ...state.circle };
  if (edgeBusy) return;
  edgeBusy = true;
  while (edgeAsked) {
    const circle = edgeAsked;
    edgeAsked = null;
    try {
      const found = await ask(edgeOf(circle));
      edge = { ...found, image: unrolled(found), radius: circle.radius };
      byId("edge-note").textContent = "The circle is right where the edge is straight along the pink line. Left to right: "
        + "from the right side of the ball clockwise; curve: mean level.";
    } catch (error) {
      edge = null;
      byId("edge-note").textContent = error.message;
    }
    if (!state.circle) edge = null;
    drawEdge();
  }
  edgeBusy = false;
}

function unrolled({ rays, levels, steps }) {
  const canvas = document.createElement("canvas");
  canvas.width = rays;
  canvas.height = steps.length;
  const context = canvas.getContext("2d");
  const pixels = context.createImageData(rays, steps.length);
  const bytes = atob(levels);
  for (let ray = 0; ray < rays; ray++) {
    for (let k = 0; k < steps.length; k++) {
      const level = bytes.charCodeAt(ray * steps.length + k);
      pixels.data.set([level, level, level, 255], 4 * ((steps.length - 1 - k) * rays + ray));
    }
  }
  context.putImageData(pixels, 0, 0);
  return canvas;
}

function drawEdge() {
  const width = widthFor(edgeCanvas);
  const context = prepared(edgeCanvas, width, EDGE_HEIGHT);
  const left = 34, right = width - PROFILE - 10;
  if (!edge) {
    context.fillStyle = colour("quiet");
    context.textAlign = "center";
    context.fillText("no circle yet", width / 2, EDGE_HEIGHT / 2);
    if (!state.circle) byId("edge-note").textContent = "";
    edgeCanvas.dataset.drawn = "null";
    return;
  }
  const most = edge.steps[edge.steps.length - 1];
  const y = (step) => EDGE_HEIGHT / 2 - (step / most) * (EDGE_HEIGHT / 2 - 8);
  context.imageSmoothingEnabled = false;
  context.drawImage(edge.image, left, y(most), right - left, y(-most) - y(most));
  context.textAlign = "right";
  context.textBaseline = "middle";
  context.fillStyle = colour("quiet");
  for (const step of ticks(-most, most, 4)) context.fillText(tickText(step), left - 6, y(step));
  drawProfile(context, right + 10, width, y, most);
  outlined(context, () => { context.moveTo(left, y(0)); context.lineTo(right, y(0)); }, "#ff5ca8", [6, 4], 1.2);
  edgeCanvas.dataset.drawn = JSON.stringify({ rays: edge.rays, reach: most, radius: edge.radius });
}

function drawProfile(context, left, right, y, most) {
  const span = range([edge.mean]);
  context.strokeStyle = colour("line");
  context.lineWidth = 1;
  context.strokeRect(left, y(most), right - left - 1, y(-most) - y(most));
  context.beginPath();
  context.moveTo(left, y(0));
  context.lineTo(right, y(0));
  context.stroke();
  if (!span) return;
  const x = (level) => left + 6 + ((level - span[0]) / (span[1] - span[0] || 1)) * (right - left - 13);
  context.strokeStyle = colour("series-0");
  context.lineWidth = 1.8;
  for (const [start, stop] of knownRuns(edge.mean)) {
    context.beginPath();
    for (let i = start; i < stop; i++) context.lineTo(x(edge.mean[i]), y(edge.steps[i]));
    context.stroke();
  }
}
