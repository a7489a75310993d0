// The values at the frame, as text.

function drawNumbers() {
  const list = document.getElementById("values");
  list.replaceChildren();
  for (const panel of data.panels) {
    const term = document.createElement("dt");
    term.textContent = axisLabel(panel);
    const values = document.createElement("dd");
    const known = panel.values.some((column) => column[row()] !== null);
    if (known) panel.names.forEach((name, k) => values.append(component(panel, name, k)));
    else values.append("not measured");
    list.append(term, values);
  }
}

function component(panel, name, k) {
  const item = document.createElement("span");
  const value = panel.values[k][row()], sd = panel.sd && panel.sd[k][row()];
  const strong = document.createElement("b");
  strong.textContent = number(value, sd);
  strong.dataset.value = `${panel.key} ${name}`;
  const named = document.createElement("i");
  named.textContent = panel.names.length > 1 ? name + " " : "";
  item.append(named, strong);
  if (value !== null && sd > 0) item.append(" \u00b1 " + number(sd, sd));
  return item;
}

function moment() {
  const { title, unit } = data.abscissa;
  const time = unit ? `, ${title} ${Number(data.where[row()].toPrecision(5))} ${unit}` : "";
  return `Frame ${data.frame[row()]}${time}: ${data.statuses[data.status[row()]].name}`;
}

function drawMoment() {
  const slider = document.getElementById("slider");
  slider.value = state.stop;
  slider.setAttribute("aria-valuetext", moment());
  document.getElementById("now").textContent = moment();
}

function writeNotes() {
  const count = data.shown.length;
  document.getElementById("sampling").textContent = count < data.total
    ? `${count} of ${data.total} frames are shown: the first, the last, the worst, those not measured (or evenly picked `
      + "ones of them), and between them evenly. All are in track.csv."
    : "";
  const shaded = (data.contact ? " Yellow: contact." : "")
    + (data.status.some((s) => s > 1) ? " Grey: not measured." : "");
  const thinned = data.where.length < data.total ? ` ${data.where.length} of ${data.total} frames are plotted.` : "";
  const points = data.panels.some((panel) => panel.raw) ? " Grey points: raw differences." : "";
  const frame = data.lab && data.panels[0].unit !== "px" ? "Lab frame: x right, y up, z to the camera."
    : "Camera frame: x right, y down, z away.";
  document.getElementById("plots-note").replaceChildren(
    `${frame} Bands: 2 standard deviations (sd); below each plot: the sd.${points}${shaded}${thinned}`,
    onScreenOnly(" Click or drag to go there; drag with Shift to zoom, double click for the whole."));
}
