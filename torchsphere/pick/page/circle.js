// The circle to begin with: found by the program, drawn, or fitted to the edge.

const ORIGINS = {
  found: (circle) => `Found in frame ${circle.frame}, ${circle.about}; a measurement finds it again. Drag it if it is wrong.`,
  drawn: (circle) => `Drawn in frame ${circle.frame}, where the measurement begins.`,
  fitted: (circle) => `Fitted in frame ${circle.frame}, ${circle.about}; the measurement begins there.`,
};
let searches = 0, isSearching = false;

// Takes a circle for the one to begin with; a drawn one lies in the first frame that is measured.
function setCircle(circle) {
  state.circle = circle;
  searches++;
  if (circle && circle.origin !== "found") {
    if (isSearching) ask("give-up", {}).catch((error) => say(error.message, "bad"));
    state.others = [];
    byId("show-pick").checked = true;
    if (state.first !== circle.frame && circle.frame < state.last) {
      state.first = circle.frame;
      say(`The circle lies in frame ${circle.frame}; the measurement begins there.`);
    }
  }
  showCircle();
  updateEdge();
  changed();
}

function showCircle() {
  const circle = state.circle;
  document.body.dataset.circle = circle ? circle.origin : "none";
  showToolNote();
  for (const name of ["x", "y", "radius"]) {
    const input = byId(`circle-${name}`);
    if (document.activeElement !== input) input.value = circle ? circle[name].toFixed(2) : "";
  }
  byId("circle-note").textContent = circle ? ORIGINS[circle.origin](circle)
    : "None: the program finds the ball by itself. Draw one from the middle of the ball to its rim to say where it is.";
  byId("fit").disabled = !circle;
  byId("clear").disabled = !circle || circle.origin === "found";
  byId("others").replaceChildren(...state.others.map(([x, y, radius]) => {
    const item = document.createElement("li"), button = document.createElement("button");
    button.type = "button";
    button.textContent = `Take the one at ${shortNumber(x)}, ${shortNumber(y)}`;
    button.addEventListener("click", () => setCircle({ x, y, radius, frame: circle.frame, origin: "drawn" }));
    item.append(button);
    return item;
  }));
  drawStage();
}

// The drawn circle, changed: it moves to the frame that is shown.
function draw(change) {
  const from = state.circle || { x: boot.width / 2, y: boot.height / 2, radius: Math.min(boot.width, boot.height) / 4 };
  setCircle({ x: from.x, y: from.y, radius: from.radius, ...change, frame: state.frame, origin: "drawn" });
}

async function find() {
  const number = ++searches;
  say("Looking for the ball. A circle can be drawn meanwhile.");
  byId("find").disabled = isSearching = true;
  try {
    const found = await ask("find", choice());
    // A circle that was drawn meanwhile stays.
    if (number !== searches) return;
    state.others = found.others;
    setCircle({ ...found, origin: "found" });
    if (found.frame !== state.frame) seek(found.frame);
    say(found.sentences[0] || `The ball was found at ${shortNumber(found.x)}, ${shortNumber(found.y)} px, radius `
      + `${shortNumber(found.radius)} px. Look at its edge.`, found.sentences.length ? "bad" : "good");
  } catch (error) {
    if (number === searches) say(error.message, "bad");
  } finally {
    byId("find").disabled = isSearching = false;
  }
}

async function fit() {
  if (!state.circle) return;
  const before = state.circle, number = ++searches;
  try {
    const found = await ask("fit", before);
    if (number !== searches) return;
    setCircle({ ...found, origin: "fitted" });
    const by = Math.hypot(found.x - before.x, found.y - before.y);
    say(found.sentences[0] || `Fitted: the middle moved by ${shortNumber(by)} px, the radius changed by `
      + `${shortNumber(found.radius - before.radius)} px.`, found.sentences.length ? "bad" : "good");
  } catch (error) {
    say(error.message, "bad");
  }
}
