"use strict";
// Canvases and colours of all pages.

function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
}

// Gives a canvas its size in CSS px, sharp on every screen, and returns its cleared context.
function prepared(canvas, width, height) {
  const ratio = window.devicePixelRatio || 1;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  canvas.style.width = width + "px";
  canvas.style.height = height + "px";
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = "12px system-ui, 'DejaVu Sans', sans-serif";
  return context;
}

function widthFor(canvas) {
  const box = canvas.parentElement;
  const style = getComputedStyle(box);
  return Math.floor(box.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight));
}

function number(value, sd) {
  if (value === null || value === undefined) return "not measured";
  const digits = sd > 0 ? Math.min(Math.max(1 - Math.floor(Math.log10(sd)), 0), 9) : null;
  // More than five decimals are written as a power of ten.
  const text = digits > 5 ? value.toExponential(Math.max(digits + Math.floor(Math.log10(Math.abs(value) || sd)), 0))
    : digits === null ? String(Number(value.toPrecision(5))) : value.toFixed(digits);
  return text.replaceAll("-", "\u2212");
}
