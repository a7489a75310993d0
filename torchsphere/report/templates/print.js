// A printed page has light colours, its details open, and canvases that fit the paper; `draw` draws these again.

// Words on what keys and mouse do, which paper leaves out.
function onScreenOnly(text) {
  const span = document.createElement("span");
  span.className = "keys";
  span.textContent = text;
  return span;
}

function drawForPrint(draw) {
  const opened = [];
  window.addEventListener("beforeprint", () => {
    document.documentElement.classList.add("printed");
    opened.push(...document.querySelectorAll("details:not([open])"));
    for (const details of opened) details.open = true;
    draw();
  });
  window.addEventListener("afterprint", () => {
    document.documentElement.classList.remove("printed");
    for (const details of opened.splice(0)) details.open = false;
    draw();
  });
}
