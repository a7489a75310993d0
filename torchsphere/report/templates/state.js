"use strict";
// What the page shows, and the one frame that all parts of it are at. Rows are frames that the page knows; stops are
// the rows at which it can stop, because there is an image of them.

const data = JSON.parse(document.getElementById("data").textContent);
const state = { stop: 0, playing: false };
const listeners = [];
// What was drawn where, in CSS px of each canvas: for checks from outside.
const drawn = {};

function row() {
  return data.shown[state.stop];
}

function onChange(listener) {
  listeners.push(listener);
}

function changed() {
  for (const listener of listeners) listener();
}

function seek(stop) {
  const bounded = Math.min(Math.max(stop, 0), data.shown.length - 1);
  if (bounded === state.stop) return;
  state.stop = bounded;
  changed();
}

function seekTo(where) {
  let best = 0;
  data.shown.forEach((r, stop) => {
    if (Math.abs(data.where[r] - where) < Math.abs(data.where[data.shown[best]] - where)) best = stop;
  });
  seek(best);
}

function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
}

// A canvas of that size in CSS px, sharp on any screen, and its cleared context.
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
  // Beyond five decimals zeros crowd out what is meant.
  const text = digits > 5 ? value.toExponential(Math.max(digits + Math.floor(Math.log10(Math.abs(value) || sd)), 0))
    : digits === null ? String(Number(value.toPrecision(5))) : value.toFixed(digits);
  return text.replaceAll("-", "\u2212");
}
