// Below a plot, its standard deviations on a scale of their own: the band of a good measurement is thinner than its
// curve. In a plot without values, the reason.

const DEVIATIONS = { seam: 5, height: 26 };

// Height of the strip with the standard deviations, CSS px.
function deviationsHeight(panel) {
  return panel.sd && range(panel.sd) ? DEVIATIONS.seam + DEVIATIONS.height : 0;
}

function drawDeviations(context, panel, across, bottom, x) {
  const floor = bottom + DEVIATIONS.seam + DEVIATIONS.height;
  const most = 1.1 * range(panel.sd)[1] || 1;
  const y = (v) => floor - (v / most) * DEVIATIONS.height;
  context.strokeStyle = colour("line");
  context.lineWidth = 1;
  context.strokeRect(across.left, floor - DEVIATIONS.height, across.width, DEVIATIONS.height);
  context.fillStyle = colour("quiet");
  context.textBaseline = "middle";
  context.textAlign = "right";
  const [tick] = ticks(0, most, 2).slice(-1);
  context.fillText(tickText(tick), across.left - 6, Math.max(y(tick), floor - DEVIATIONS.height + 4),
    across.left - 26);
  context.textAlign = "left";
  context.fillText("sd", 2, floor - DEVIATIONS.height / 2);
  context.lineWidth = 1.2;
  within(context, across, bottom, floor, () => panel.sd.forEach((values, k) => {
    context.strokeStyle = colour("series-" + k);
    context.setLineDash(DASHES[k]);
    for (const [start, stop] of knownRuns(values)) {
      context.beginPath();
      for (let i = start; i < stop; i++) context.lineTo(x(data.where[i]), y(values[i]));
      context.stroke();
    }
  }));
  context.setLineDash([]);
  return { top: floor - DEVIATIONS.height, bottom: floor, most };
}

// Writes the sentence in the middle of the plot, in lines that fit.
function drawWhy(context, sentence, across, bottom) {
  const lines = [""];
  for (const word of sentence.split(/\s+/)) {
    const longer = `${lines[lines.length - 1]} ${word}`.trim();
    if (context.measureText(longer).width <= across.width - 16) lines[lines.length - 1] = longer;
    else lines.push(word);
  }
  context.fillStyle = colour("ink");
  context.textAlign = "center";
  context.textBaseline = "middle";
  const middle = (MARGIN.top + bottom) / 2 - 8 * (lines.length - 1);
  lines.forEach((line, i) => context.fillText(line, across.left + across.width / 2, middle + 16 * i));
}
