// The data of the page, and the frame that all parts show. A row is a frame in the data. A stop is a row at which the
// page can stop: a row with an image, or any row if the result keeps no images.

const data = JSON.parse(document.getElementById("data").textContent);
// The plots show a range of the abscissa, or all; the pointer is over a row, or none.
const state = { stop: 0, playing: false, range: null, hover: null };
const listeners = [];
// Positions of what was drawn, CSS px of each canvas, for tests.
const drawn = {};

function row() {
  return data.shown[state.stop];
}

function onChange(listener) {
  listeners.push(listener);
}

function changed() {
  for (const listener of listeners) listener();
}

function seek(stop) {
  const bounded = Math.min(Math.max(stop, 0), data.shown.length - 1);
  if (bounded === state.stop) return;
  state.stop = bounded;
  changed();
}

function seekTo(where) {
  let best = 0;
  data.shown.forEach((r, stop) => {
    if (Math.abs(data.where[r] - where) < Math.abs(data.where[data.shown[best]] - where)) best = stop;
  });
  seek(best);
}
