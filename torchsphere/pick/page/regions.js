// Ignored regions: polygons, drawn or written, and masks that the command was started with.

function regionText(region) {
  return Array.isArray(region) ? region.map(([x, y]) => `${Number(x.toFixed(1))},${Number(y.toFixed(1))}`).join(" ") : region;
}

// Corners of a text 'x,y x,y x,y', or the text itself where it is none.
function regionOf(text) {
  const numbers = text.trim().split(/[\s,]+/).map(Number);
  if (numbers.length < 6 || numbers.length % 2 || !numbers.every(Number.isFinite)) return text.trim();
  return Array.from({ length: numbers.length / 2 }, (_, i) => [numbers[2 * i], numbers[2 * i + 1]]);
}

function showRegions() {
  byId("ignore-note").hidden = state.regions.length > 0;
  byId("regions").replaceChildren(...state.regions.map((region, i) => {
    const item = document.createElement("li"), input = document.createElement("input"), button = document.createElement("button");
    input.type = "text";
    input.value = regionText(region);
    input.placeholder = "x,y x,y x,y";
    input.setAttribute("aria-label", `Corners of region ${i + 1}, px`);
    input.addEventListener("change", () => { state.regions[i] = regionOf(input.value); changed(); drawStage(); });
    button.type = "button";
    button.textContent = "Remove";
    button.setAttribute("aria-label", `Remove region ${i + 1}`);
    button.addEventListener("click", () => {
      state.regions.splice(i, 1);
      showRegions();
      byId("add-region").focus();
      say(`Region ${i + 1} was removed.`);
    });
    item.append(input, button);
    return item;
  }));
  changed();
  drawStage();
}

function addCorner(x, y) {
  const inside = (v, most) => Math.min(Math.max(v, -0.5), most - 0.5);
  state.corners.push([inside(x, boot.width), inside(y, boot.height)]);
  drawStage();
  if (state.corners.length < 3) say(`Corner ${state.corners.length} of a region.`);
  else say("Click on the first corner, or press shift and enter, to close the region.");
}

function closeRegion() {
  if (state.corners.length < 3) return say("A region needs three corners or more.", "bad");
  state.regions.push(state.corners);
  state.corners = [];
  showRegions();
  say(`Region ${state.regions.length} is ignored in every frame.`, "good");
}

function dropCorners(all) {
  if (!state.corners.length) return;
  if (all) state.corners = [];
  else state.corners.pop();
  drawStage();
}
