// The part of the recording that the plots show: buttons, keys, or a drag with Shift.

const FEWEST_FRAMES = 3;

// Shows a part of the time axis, at least a few frames and at most all.
function zoomTo(from, to) {
  const [first, last] = wholeRange();
  const least = Math.min(FEWEST_FRAMES * (last - first) / data.where.length, last - first);
  const width = Math.min(Math.max(to - from, least), last - first);
  const start = Math.min(Math.max(0.5 * (from + to - width), first), last - width);
  state.range = width < (last - first) * (1 - 1e-9) ? [start, start + width] : null;
  changed();
}

// A factor below 1 zooms in, about the frame that is shown if it is in view.
function zoomBy(factor) {
  const [from, to] = shownRange();
  const at = data.where[row()];
  const middle = at >= from && at <= to ? at : 0.5 * (from + to);
  zoomTo(middle - factor * (middle - from), middle + factor * (to - middle));
}

function zoomWhole() {
  state.range = null;
  changed();
}

function zoomContact() {
  const [from, to] = data.contact;
  zoomTo(from - 1.5 * (to - from), to + 1.5 * (to - from));
}

function drawZoom() {
  const [from, to] = shownRange();
  document.getElementById("zoom-out").disabled = document.getElementById("zoom-whole").disabled = !state.range;
  const rows = data.where.filter((v) => v >= from && v <= to).length;
  document.getElementById("zoom-in").disabled = rows <= FEWEST_FRAMES;
  const short = (v) => Number(v.toPrecision(4)).toString().replace("-", "\u2212");
  document.getElementById("zoom-note").textContent = state.range
    ? `${short(from)} to ${short(to)}${data.abscissa.unit ? " " + data.abscissa.unit : ""}` : "";
}

function makeZoom() {
  const click = (id, does) => document.getElementById(id).addEventListener("click", does);
  click("zoom-in", () => zoomBy(0.5));
  click("zoom-out", () => zoomBy(2));
  click("zoom-whole", zoomWhole);
  click("zoom-contact", zoomContact);
  document.getElementById("zoom-contact").hidden = !data.contact;
  document.getElementById("plots").addEventListener("dblclick", zoomWhole);
}
