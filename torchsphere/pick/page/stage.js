// The frame: its image, the place and scale at which it is shown, and all that is drawn over it.

const stage = byId("stage");
const MOST_ZOOM = 40, MOST_IMAGES = 48, GRIP = 8;
const images = new Map();
// Px of the canvas per px of the recording, and the place of the recording at the canvas's upper left corner.
const view = { scale: 1, left: -0.5, top: -0.5, width: 300, height: 150, fits: true };
let shown = null;

function address(frame) {
  const { black, white } = state.levels;
  const asked = black === boot.black && white === boot.white ? "" : `&black=${black}&white=${white}`;
  return `frame?n=${frame}${asked}`;
}

// The image of a frame, null until it is there; the last ones are kept.
function imageOf(frame) {
  const key = address(frame);
  let image = images.get(key);
  if (image) images.delete(key);
  else {
    image = new Image();
    image.addEventListener("load", () => { if (address(state.frame) === key) drawStage(); });
    image.addEventListener("error", () => unreadable(key));
    image.src = key;
  }
  images.set(key, image);
  while (images.size > MOST_IMAGES) images.delete(images.keys().next().value);
  return image.complete && image.naturalWidth ? image : null;
}

async function unreadable(key) {
  images.delete(key);
  try {
    await ask(key);
  } catch (error) {
    say(error.message, "bad");
  }
}

function smallestScale() {
  return Math.min(view.width / boot.width, view.height / boot.height);
}

function layOut() {
  view.width = Math.max(widthFor(stage), 120);
  const tallest = Math.max(0.62 * window.innerHeight, 220);
  view.height = Math.round(Math.min(Math.max((view.width * boot.height) / boot.width, 160), tallest));
  if (view.fits) view.scale = smallestScale();
  settle();
}

// Keeps the image in view, in the middle where it is smaller than the canvas.
function settle() {
  view.scale = Math.min(Math.max(view.scale, smallestScale()), Math.max(MOST_ZOOM, smallestScale()));
  for (const [side, size, length] of [["left", "width", boot.width], ["top", "height", boot.height]]) {
    const seen = view[size] / view.scale;
    view[side] = seen >= length ? -0.5 - (seen - length) / 2
      : Math.min(Math.max(view[side], -0.5), length - 0.5 - seen);
  }
  view.fits = view.scale <= smallestScale() * 1.0001;
}

const here = (x, y) => [(x - view.left) * view.scale, (y - view.top) * view.scale];
const there = (x, y) => [x / view.scale + view.left, y / view.scale + view.top];

function zoom(factor, at = [view.width / 2, view.height / 2]) {
  const [x, y] = there(...at);
  view.scale *= factor;
  view.scale = Math.min(Math.max(view.scale, smallestScale()), Math.max(MOST_ZOOM, smallestScale()));
  view.left = x - at[0] / view.scale;
  view.top = y - at[1] / view.scale;
  settle();
  drawStage();
}

function zoomAll() {
  view.scale = smallestScale();
  settle();
  drawStage();
}

function zoomBall() {
  const ball = isMeasured() ? { x: data.position[row()][0], y: data.position[row()][1], radius: data.radius[row()] }
    : state.circle;
  if (!ball) return say("There is no circle to zoom to yet: find the ball, or draw a circle.", "bad");
  view.scale = Math.min(view.width, view.height) / (2.6 * ball.radius);
  settle();
  view.left = ball.x - view.width / 2 / view.scale;
  view.top = ball.y - view.height / 2 / view.scale;
  settle();
  drawStage();
}

function pan(dx, dy) {
  view.left -= dx / view.scale;
  view.top -= dy / view.scale;
  settle();
  drawStage();
}

function drawStage() {
  const context = prepared(stage, view.width, view.height);
  context.fillStyle = "#0b0d10";
  context.fillRect(0, 0, view.width, view.height);
  const image = imageOf(state.frame);
  if (image) shown = { image, frame: state.frame };
  if (shown) {
    context.imageSmoothingEnabled = view.scale < 3;
    context.drawImage(shown.image, ...here(-0.5, -0.5), boot.width * view.scale, boot.height * view.scale);
  }
  for (const next of [1, -1, 2]) {
    if (image && state.frame + next >= 0 && state.frame + next < boot.count) imageOf(state.frame + next);
  }
  drawn.stage = { frame: shown && shown.frame, scale: view.scale, left: view.left, top: view.top, circle: null, axes: null };
  if (byId("show-ignore").checked) drawRegions(context);
  if (isMeasured()) drawMeasured(context);
  if (byId("show-pick").checked) drawPicked(context);
  stage.dataset.drawn = JSON.stringify(drawn.stage);
}

function drawMeasured(context) {
  drawPath(context, here, data.position);
  const seen = drawBall(context, here(...data.position[row()]), data.radius[row()] * view.scale, matrix(data.quaternion[row()]));
  Object.assign(drawn.stage, { measured: seen.circle, axes: seen.axes });
}

// The circle to begin with: whole in its own frame if it was drawn, dashed if it was found; dotted in other frames.
function drawPicked(context) {
  for (const [x, y, radius] of state.circle && state.frame === state.circle.frame ? state.others : []) {
    outlined(context, () => context.arc(...here(x, y), radius * view.scale, 0, 2 * Math.PI), "#ffffff", [2, 4]);
  }
  if (!state.circle) return;
  const { x, y, radius, frame, origin } = state.circle;
  const isOwn = frame === state.frame, centre = here(x, y);
  const dashes = !isOwn ? [1.5, 5] : origin === "found" ? [7, 4] : [];
  outlined(context, () => context.arc(...centre, radius * view.scale, 0, 2 * Math.PI), "#ff5ca8", dashes);
  if (isOwn) {
    outlined(context, () => {
      context.moveTo(centre[0] - 6, centre[1]); context.lineTo(centre[0] + 6, centre[1]);
      context.moveTo(centre[0], centre[1] - 6); context.lineTo(centre[0], centre[1] + 6);
    }, "#ff5ca8", []);
  }
  drawn.stage.circle = [...centre, radius * view.scale];
}

// A line that is seen on bright and dark ground.
function outlined(context, path, paint, dashes, width = 2) {
  context.setLineDash(dashes);
  for (const [colour, wide] of [["#00000080", width + 1.5], [paint, width]]) {
    context.strokeStyle = colour;
    context.lineWidth = wide;
    context.beginPath();
    path();
    context.stroke();
  }
  context.setLineDash([]);
}

function drawRegions(context) {
  for (const region of state.regions) if (Array.isArray(region)) drawRegion(context, region, true);
  if (state.corners.length) drawRegion(context, state.corners, false);
  if (state.tool === "ignore" && state.cross) {
    const [x, y] = here(...state.cross);
    outlined(context, () => {
      context.moveTo(x - 12, y); context.lineTo(x + 12, y); context.moveTo(x, y - 12); context.lineTo(x, y + 12);
    }, "#ffffff", []);
  }
}

function drawRegion(context, corners, closed) {
  const places = corners.map(([x, y]) => here(x, y));
  const path = () => {
    for (const place of places) context.lineTo(...place);
    if (closed) context.closePath();
  };
  if (closed) {
    context.save();
    context.beginPath();
    path();
    context.fillStyle = "#00000066";
    context.fill();
    context.clip();
    context.strokeStyle = "#ffb000b0";
    context.lineWidth = 1;
    context.beginPath();
    for (let at = -view.height; at < view.width; at += 8) {
      context.moveTo(at, view.height);
      context.lineTo(at + view.height, 0);
    }
    context.stroke();
    context.restore();
  }
  outlined(context, path, "#ffb000", closed ? [] : [5, 3]);
  if (state.tool !== "ignore") return;
  for (const [x, y] of places) {
    context.fillStyle = "#000000";
    context.fillRect(x - 4, y - 4, 8, 8);
    context.fillStyle = "#ffb000";
    context.fillRect(x - 3, y - 3, 6, 6);
  }
}
