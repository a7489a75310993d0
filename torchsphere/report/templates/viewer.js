// The frame with the measured circle, axes, graticule and path, and its residual map.

const frameCanvas = document.getElementById("frame");
const residualCanvas = document.getElementById("residual");
const pictures = new Map();
const maps = new Map();

// The image of a data address, or null until it is decoded; `then` is called after that.
function picture(address, then) {
  let image = pictures.get(address);
  if (!image) {
    image = new Image();
    image.src = address;
    pictures.set(address, image);
  }
  if (image.complete) return image;
  image.addEventListener("load", then, { once: true });
  return null;
}

// The part of the image to show: left, top, width, height, px of the recording.
function shownBox() {
  if (data.images) return data.images.box;
  const known = data.position.map((p, i) => [p[0], p[1], data.radius[i]]).filter((p) => p[0] !== null);
  if (!known.length) return [0, 0, 320, 80];
  const low = [0, 1].map((k) => Math.min(...known.map((p) => p[k] - 1.5 * p[2])));
  const high = [0, 1].map((k) => Math.max(...known.map((p) => p[k] + 1.5 * p[2])));
  return [low[0], low[1], high[0] - low[0], high[1] - low[1]];
}

function drawFrame() {
  const [left, top, width, height] = shownBox();
  const scale = Math.min(widthFor(frameCanvas) / width, Math.max(460 / height, 0.5), 6);
  const context = prepared(frameCanvas, width * scale, height * scale);
  const here = (x, y) => [(x - left) * scale, (y - top) * scale];
  if (data.images) {
    const image = picture(data.images.frames[state.stop], drawFrame);
    if (image) context.drawImage(image, 0, 0, width * scale, height * scale);
  } else {
    context.fillStyle = "#333a42";
    context.fillRect(0, 0, width * scale, height * scale);
  }
  drawPath(context, here, data.position);
  const at = data.position[row()];
  const isPlaced = at[0] !== null;
  const seen = isPlaced ? drawBall(context, here(...at), data.radius[row()] * scale, matrix(data.quaternion[row()]))
    : { circle: null, axes: null, front: null };
  if (!isPlaced) frameNote(context, width * scale, height * scale);
  drawn.frame = { scale, ...seen };
  frameCanvas.dataset.drawn = JSON.stringify(drawn.frame);
}

function frameNote(context, width, height) {
  context.font = "14px system-ui, 'DejaVu Sans', sans-serif";
  label(context, "the place of the ball is not measured here", width / 2, height - 16, "#ffffff");
}

function drawResidual() {
  const size = Math.min(widthFor(residualCanvas), 240);
  const context = prepared(residualCanvas, size, size + 44);
  const address = data.images && data.images.maps[state.stop];
  context.fillStyle = colour("quiet");
  context.textAlign = "center";
  residualNote(address);
  if (!address) {
    context.fillText("not measured", size / 2, size / 2);
    return;
  }
  const image = picture(address, drawResidual);
  if (!image) return;
  if (!maps.has(address)) maps.set(address, coloured(image));
  context.imageSmoothingEnabled = false;
  context.drawImage(maps.get(address), 0, 0, size, size);
  colourBar(context, size);
}

function residualNote(address) {
  const text = !data.images ? "No images were kept with this result."
    : address ? "This image minus the one before it, carried along with the ball: what looks like noise is good, "
      + `shapes are motion, light or cover that is not explained. The map is ${Math.round(data.images.mapWidth)} px wide.`
    : data.frame[row()] === data.frame[0] ? "The first frame has none before it to be compared with."
    : "The step that leads to this frame was not measured in full, so there is nothing to compare with.";
  document.getElementById("residual-note").textContent = text;
}

// Blue for darker and red for brighter than expected, white for equal; grey for no residual.
function residualColour(share) {
  const end = share < 0 ? [33, 102, 172] : [178, 24, 43];
  return end.map((v) => 255 + (v - 255) * Math.min(Math.abs(share), 1));
}

function coloured(image) {
  const canvas = document.createElement("canvas");
  canvas.width = image.naturalWidth;
  canvas.height = image.naturalHeight;
  const context = canvas.getContext("2d");
  context.drawImage(image, 0, 0);
  const pixels = context.getImageData(0, 0, canvas.width, canvas.height);
  const { mapMiddle, mapReach } = data.images;
  const least = 0.6 * (mapMiddle - mapReach);
  for (let i = 0; i < pixels.data.length; i += 4) {
    const grey = pixels.data[i];
    if (grey < least) pixels.data[i + 3] = 0;
    else pixels.data.set(residualColour((grey - mapMiddle) / mapReach), i);
  }
  context.putImageData(pixels, 0, 0);
  return canvas;
}

function colourBar(context, size) {
  for (let i = 0; i < size; i++) {
    const [r, g, b] = residualColour((2 * i) / (size - 1) - 1);
    context.fillStyle = `rgb(${r},${g},${b})`;
    context.fillRect(i, size + 8, 1, 12);
  }
  const limit = Number(data.images.limit.toPrecision(2));
  context.fillStyle = colour("ink");
  [["left", 0, "\u2212" + limit], ["center", size / 2, "0 grey levels"], ["right", size, "+" + limit]].forEach(
    ([align, x, text]) => {
      context.textAlign = align;
      context.textBaseline = "top";
      context.fillText(text, x, size + 25);
    });
}
