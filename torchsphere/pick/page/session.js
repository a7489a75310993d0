// What the page works on. `data` has the form that the plots and the strip of the report read: a row per frame that is
// measured, empty until it is done.

const boot = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);
const NOT_YET = boot.statuses.length;
const state = {
  frame: 0,
  first: 0,
  last: boot.count - 1,
  tool: "circle",
  playing: false,
  // {x, y, radius, frame, origin: "found", "drawn" or "fitted"}, px; null if there is none.
  circle: null,
  others: [],
  // Corners [[x, y], ...] or the path of a mask; and the corners of the one that is being drawn.
  regions: [],
  corners: [],
  cross: null,
  levels: { black: boot.black, white: boot.white },
  job: "none",
  // For the plots: they show all frames; the pointer is over a row, or none.
  range: null,
  hover: null,
};
const data = { panels: [], contact: null, abscissa: { title: "frame", unit: "" }, statuses: [] };
// Positions of what was drawn, CSS px of each canvas, for tests.
const drawn = {};

function emptyRows(first, last) {
  const count = last - first + 1;
  const none = () => Array(count).fill(null);
  data.where = data.frame = Array.from({ length: count }, (_, i) => first + i);
  data.status = Array(count).fill(NOT_YET);
  data.position = Array.from({ length: count }, () => [null, null]);
  data.radius = none();
  data.quaternion = Array.from({ length: count }, () => [null, null, null, null]);
  const panel = (key, title, unit, names) => ({ key, title, unit, names, values: names.map(none), sd: null, why: "" });
  data.panels = [
    panel("position", "position", "px", ["x", "y"]),
    panel("turned", "turned angle", "deg", ["x", "y", "z"]),
    panel("zncc", "correlation", "", ["ZNCC"]),
  ];
  data.statuses = [...boot.statuses, { name: "not measured yet", colour: "#8b95a1" }]
    .map((status) => ({ ...status, count: 0, meaning: "" }));
}

// The row of the shown frame, or the nearest one that there is.
function row() {
  return Math.min(Math.max(state.frame - data.where[0], 0), data.where.length - 1);
}

function isMeasured() {
  const at = state.frame - data.where[0];
  return state.job !== "none" && at >= 0 && at < data.where.length && data.position[at][0] !== null;
}

function say(sentence, grade = "") {
  byId("said").textContent = sentence;
  byId("said").className = `said ${grade}`;
}

// Asks the server; the answer, or an error with the server's sentence.
async function ask(path, body) {
  const options = body === undefined ? {} : {
    method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body),
  };
  let answer;
  try {
    answer = await fetch(path, options);
  } catch {
    throw new Error("The command that serves this page has ended; start torchsphere pick again.");
  }
  const found = await answer.json();
  if (!answer.ok) throw new Error(found.error);
  return found;
}

function shortNumber(value) {
  return String(Number(value.toFixed(2))).replace("-", "\u2212");
}
