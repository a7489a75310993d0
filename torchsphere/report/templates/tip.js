// The values under the pointer: a line in all plots, and a box with the numbers of the plot that it is in.

const tip = document.getElementById("tip");

function nearestRow(where) {
  let best = 0;
  data.where.forEach((v, i) => { if (Math.abs(v - where) < Math.abs(data.where[best] - where)) best = i; });
  return best;
}

function showTip(panel, canvas, event) {
  const { left, width, from, to } = drawn.plots[panel.key];
  const x = event.clientX - canvas.getBoundingClientRect().left;
  if (!panel.limits || x < left || x > left + width) { hideTip(); return; }
  state.hover = nearestRow(from + ((x - left) / width) * (to - from));
  writeTip(panel);
  tip.hidden = false;
  const holder = tip.parentElement;
  const right = canvas.offsetLeft + x + 14;
  // On the other side of the pointer where the box would leave the plots.
  const fits = right + tip.offsetWidth <= holder.clientWidth;
  const beside = fits ? right : canvas.offsetLeft + x - 14 - tip.offsetWidth;
  tip.style.left = Math.max(0, Math.min(beside, holder.clientWidth - tip.offsetWidth)) + "px";
  tip.style.top = canvas.offsetTop + MARGIN.top + 4 + "px";
  drawPlots();
}

function hideTip() {
  if (state.hover === null) return;
  state.hover = null;
  tip.hidden = true;
  drawPlots();
}

function writeTip(panel) {
  const i = state.hover;
  const head = document.createElement("b");
  const { unit } = data.abscissa;
  head.textContent = `Frame ${data.frame[i]}` + (unit ? `, ${Number(data.where[i].toPrecision(5))} ${unit}` : "");
  const lines = panel.names.map((name, k) => {
    const line = document.createElement("span");
    const value = panel.values[k][i], sd = panel.sd && panel.sd[k][i];
    const text = number(value, sd) + (value !== null && sd > 0 ? ` \u00b1 ${number(sd, sd)}` : "");
    line.textContent = `${name} ${text}${value !== null && panel.unit ? " " + panel.unit : ""}`;
    return line;
  });
  tip.replaceChildren(head, ...lines);
}
