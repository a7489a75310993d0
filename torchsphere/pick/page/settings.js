// The settings as the server takes them, checked after every change, and written to the file.

let checkTimer = 0, checks = 0;

function choice() {
  const fields = {};
  for (const input of byId("form").elements) {
    if (input.name) fields[input.name] = input.type === "checkbox" ? input.checked : input.value;
  }
  const circle = state.circle && state.circle.origin !== "found" ? state.circle : null;
  return {
    fields,
    circle: circle && { x: circle.x, y: circle.y, radius: circle.radius, frame: circle.frame },
    frames: [state.first, state.last],
    ignore: state.regions.map(regionText).filter(Boolean),
    replace: byId("replace").checked,
  };
}

// Something was changed: the range is shown, and the settings are checked after a pause.
function changed() {
  showRange();
  clearTimeout(checkTimer);
  checkTimer = setTimeout(check, 200);
}

async function check() {
  const number = ++checks;
  try {
    const { toml, error, fields } = await ask("check", choice());
    if (number !== checks) return;
    byId("toml").textContent = error ? "" : toml;
    refuse(error || "", fields || []);
  } catch (error) {
    if (number === checks) refuse(error.message, []);
  }
}

function refuse(sentence, fields) {
  if (byId("refusal").textContent !== sentence) byId("refusal").textContent = sentence;
  for (const input of byId("form").elements) {
    if (input.name) input.setAttribute("aria-invalid", String(fields.includes(input.name)));
  }
  byId("track").disabled = byId("save").disabled = sentence !== "" || state.job === "running";
}

function mark(which, frame) {
  const bounded = Math.min(Math.max(Math.round(frame), 0), boot.count - 1);
  state[which] = bounded;
  say(which === "first" ? `The measurement begins at frame ${bounded}.` : `Frame ${bounded} is the last to be measured.`);
  changed();
}

function showRange() {
  for (const which of ["first", "last"]) {
    if (document.activeElement !== byId(which)) byId(which).value = state[which];
  }
  const share = 100 / boot.count;
  byId("span").style.left = `${share * state.first}%`;
  byId("span").style.width = `${Math.max(share * (state.last - state.first + 1), 0)}%`;
}

async function save() {
  try {
    const { path } = await ask("save", choice());
    say(`The settings were written to ${path}.`, "good");
  } catch (error) {
    say(error.message, "bad");
  }
}
