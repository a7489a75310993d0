// Axes of plots: margins, limits, ticks and labels.

const MARGIN = { left: 58, right: 12, top: 24, bottom: 20 };

function range(lists) {
  let low = Infinity, high = -Infinity;
  for (const list of lists) {
    for (const v of list) {
      if (v !== null && v < low) low = v;
      if (v !== null && v > high) high = v;
    }
  }
  return low <= high ? [low, high] : null;
}

function ticks(low, high, count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= rough);
  const found = [];
  for (let i = Math.ceil(low / step); i * step <= high + 1e-9 * step; i++) found.push(Number((i * step).toPrecision(12)));
  return found;
}

function tickText(value) {
  return String(value).replace("-", "\u2212");
}

function axisLabel({ title, unit }) {
  return unit ? `${title} (${unit})` : title;
}

function knownRuns(values) {
  const runs = [];
  let start = -1;
  for (let i = 0; i <= values.length; i++) {
    const known = i < values.length && values[i] !== null;
    if (known && start < 0) start = i;
    if (!known && start >= 0) { runs.push([start, i]); start = -1; }
  }
  return runs;
}
