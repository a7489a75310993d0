"use strict";
// The table of recordings. Rows are sorted and searched in memory; the document has one page of rows at a time.

const PAGE = 200;
const SEVERE = "done, severe";
const { columns, rows } = JSON.parse(document.getElementById("data").textContent);
const table = document.getElementById("table");
const byId = (id) => document.getElementById(id);
const look = { column: -1, falling: false, page: 0 };
const stateColumn = columns.indexOf("state"), severeColumn = columns.indexOf("severe_warnings");
let found = rows;

// "peak_force_N" -> "peak force (N)": the unit is the end of the name.
function heading(name) {
  const unit = name.match(/_(px|mm|m|s|ms|us|N|kN|J|deg|rad|m_s|rad_s|rev_s|fps|percent)$/);
  const words = (unit ? name.slice(0, unit.index) : name).replaceAll("_", " ");
  return unit ? `${words} (${unit[1].replace("_s", "/s").replace("percent", "%")})` : words;
}

// "done, 3 severe": a result that is there, and numbers in it that are wrong.
function severeOf({ cells }) {
  return cells[stateColumn] === "done" ? cells[severeColumn] || 0 : 0;
}

function stateOf(row) {
  const severe = severeOf(row);
  return severe ? `${row.cells[stateColumn]}, ${severe} severe` : row.cells[stateColumn];
}

function compare(a, b) {
  if (a === null || b === null) return (a === null) - (b === null);
  const order = typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b));
  return look.falling ? -order : order;
}

function update() {
  const words = byId("search").value.toLowerCase(), state = byId("state").value;
  found = rows.filter((row) => (!state || row.cells[stateColumn] === state || (state === SEVERE && severeOf(row)))
    && (!words || row.cells.some((cell) => cell !== null && String(cell).toLowerCase().includes(words))));
  if (look.column >= 0) found.sort((a, b) => compare(a.cells[look.column], b.cells[look.column]));
  const pages = Math.max(Math.ceil(found.length / PAGE), 1);
  look.page = Math.min(Math.max(look.page, 0), pages - 1);
  const first = look.page * PAGE, last = Math.min(first + PAGE, found.length);
  byId("page").textContent = found.length ? `${first + 1} to ${last} of ${found.length}` : "none match";
  byId("previous").disabled = look.page === 0;
  byId("next").disabled = look.page === pages - 1;
  table.tBodies[0].replaceChildren(...found.slice(first, last).map(line));
  [...table.tHead.rows[0].cells].slice(1).forEach((cell, k) => {
    cell.setAttribute("aria-sort", k !== look.column ? "none" : look.falling ? "descending" : "ascending");
    cell.firstChild.textContent = heading(columns[k]) + (k !== look.column ? "" : look.falling ? " \u25bc" : " \u25b2");
  });
}

function line(row) {
  const tr = document.createElement("tr");
  tr.append(pictureCell(row), ...row.cells.map((value, k) => cell(value, columns[k], row)));
  return tr;
}

function pictureCell({ picture, cells }) {
  const td = document.createElement("td");
  if (!picture) return td;
  const image = document.createElement("img");
  image.loading = "lazy";
  image.alt = `First frame of ${cells[0]} with the circle`;
  image.src = picture;
  td.append(image);
  return td;
}

function cell(value, name, row) {
  const td = document.createElement("td");
  td.className = typeof value === "number" ? "number" : name === "recording" ? "name" : name === "reason" ? "reason" : "";
  if (value === null) {
    td.className = "none";
    td.textContent = name === "reason" ? "" : "not measured";
  } else if (name === "recording" && row.report) {
    const link = document.createElement("a");
    link.href = row.report;
    link.textContent = value;
    td.append(link);
  } else if (name === "state") {
    const mark = document.createElement("span");
    mark.className = `state ${severeOf(row) ? "severe-state" : value}`;
    mark.textContent = stateOf(row);
    td.append(mark);
  } else {
    td.textContent = typeof value === "number" ? String(Number(value.toPrecision(5))).replace("-", "\u2212") : value;
  }
  return td;
}

function makeHead() {
  const head = table.tHead.rows[0];
  const picture = document.createElement("th");
  picture.textContent = "picture";
  head.append(picture);
  columns.forEach((name, k) => {
    const th = document.createElement("th");
    const button = document.createElement("button");
    button.type = "button";
    button.addEventListener("click", () => {
      look.falling = look.column === k && !look.falling;
      look.column = k;
      update();
    });
    th.append(button);
    head.append(th);
  });
}

makeHead();
for (const state of new Set(rows.map(({ cells }) => cells[stateColumn]).filter(Boolean))) {
  byId("state").append(new Option(state, state));
}
if (rows.some(severeOf)) byId("state").append(new Option(SEVERE, SEVERE));
byId("search").addEventListener("input", () => { look.page = 0; update(); });
byId("state").addEventListener("change", () => { look.page = 0; update(); });
byId("previous").addEventListener("click", () => { look.page -= 1; update(); });
byId("next").addEventListener("click", () => { look.page += 1; update(); });
update();
