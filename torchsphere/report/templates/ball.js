// What is drawn over a frame: circle, axes and graticule of the ball, and its path.

const AXIS_LENGTH = 1.3;

// Whether a kind of drawing is chosen, by its box on the page.
function wanted(name) {
  return document.getElementById("show-" + name).checked;
}

// Draws the path through `places`, px of the recording; `here` gives the place on the canvas.
function drawPath(context, here, places) {
  if (!wanted("path")) return;
  context.strokeStyle = "#ffffffa0";
  context.lineWidth = 1.2;
  context.setLineDash([4, 3]);
  context.beginPath();
  let on = false;
  for (const place of places) {
    if (place[0] !== null) on ? context.lineTo(...here(...place)) : context.moveTo(...here(...place));
    on = place[0] !== null;
  }
  context.stroke();
  context.setLineDash([]);
}

function drawCircle(context, centre, radius) {
  context.strokeStyle = "#ff5ca8";
  context.lineWidth = 1.6;
  context.beginPath();
  context.arc(...centre, radius, 0, 2 * Math.PI);
  context.stroke();
}

// Draws the ball with the orientation m, or null, and returns where circle and axes were drawn.
function drawBall(context, centre, radius, m) {
  if (m && wanted("graticule")) {
    context.strokeStyle = "#ffd84dcc";
    context.lineWidth = 1;
    for (const line of graticule(m, true)) {
      context.beginPath();
      for (const [x, y] of line) context.lineTo(centre[0] + radius * x, centre[1] + radius * y);
      context.stroke();
    }
  }
  if (wanted("circle")) drawCircle(context, centre, radius);
  const seen = m && wanted("axes") ? drawAxes(context, centre, radius, m) : { axes: null, front: null };
  return { circle: [...centre, radius], ...seen };
}

function drawAxes(context, centre, radius, m) {
  const axes = {}, front = {};
  const seen = AXES.map((axis) => ({ axis, v: turned(m, axis.direction) })).sort((a, b) => b.v[2] - a.v[2]);
  for (const { axis, v } of seen) {
    const tip = [0, 1].map((k) => centre[k] + AXIS_LENGTH * radius * v[k]);
    const isFront = v[2] < 0;
    context.strokeStyle = context.fillStyle = axis.colour;
    context.lineWidth = isFront ? 2.5 : 1.6;
    context.setLineDash(isFront ? [] : [3, 3]);
    arrow(context, centre, tip);
    const away = Math.hypot(v[0], v[1]);
    const beside = away > 0.1 ? [v[0] / away, v[1] / away] : [0.7, -0.7];
    context.font = "bold 12px system-ui, 'DejaVu Sans', sans-serif";
    label(context, axis.name, tip[0] + 9 * beside[0], tip[1] + 9 * beside[1], axis.colour);
    axes[axis.name] = tip;
    front[axis.name] = isFront;
  }
  return { axes, front };
}
