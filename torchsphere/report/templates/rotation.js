// Orientation of the ball in the camera frame: x right, y down, z away from the camera.

const AXES = [
  { name: "x", direction: [1, 0, 0], colour: "#ff8c42" },
  { name: "y", direction: [0, 1, 0], colour: "#2ec99b" },
  { name: "z", direction: [0, 0, 1], colour: "#56b4e9" },
];

// Rotation matrix, as rows, of a unit quaternion (w, x, y, z); null if it is not known.
function matrix([w, x, y, z]) {
  if (w === null) return null;
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
  ];
}

function turned(m, v) {
  return m.map((r) => r[0] * v[0] + r[1] * v[1] + r[2] * v[2]);
}

function product(a, b) {
  return a.map((r) => [0, 1, 2].map((k) => r[0] * b[0][k] + r[1] * b[1][k] + r[2] * b[2][k]));
}

// Meridians and parallels every 30 deg, as lines of points on the unit sphere; the poles are on the y axis of the ball.
const GRATICULE = (() => {
  const lines = [];
  const rad = Math.PI / 180;
  const point = (longitude, latitude) => [
    Math.cos(latitude) * Math.sin(longitude), Math.sin(latitude), -Math.cos(latitude) * Math.cos(longitude),
  ];
  const steps = (from, to) => Array.from({ length: (to - from) / 5 + 1 }, (_, i) => (from + 5 * i) * rad);
  for (let longitude = 0; longitude < 360; longitude += 30) {
    lines.push(steps(-90, 90).map((latitude) => point(longitude * rad, latitude)));
  }
  for (let latitude = -60; latitude <= 60; latitude += 30) {
    lines.push(steps(0, 360).map((longitude) => point(longitude, latitude * rad)));
  }
  return lines;
})();

// The graticule on one side of the ball, rotated by m, as lines of (x, y) on the unit disc.
function graticule(m, front) {
  const parts = [];
  for (const line of GRATICULE) {
    let part = [];
    for (const place of line.map((v) => turned(m, v))) {
      if ((place[2] < 0) === front) part.push(place);
      else if (part.length) { parts.push(part); part = []; }
    }
    if (part.length > 1) parts.push(part);
  }
  return parts;
}

function arrow(context, from, to, head = 7) {
  const length = Math.hypot(to[0] - from[0], to[1] - from[1]);
  context.beginPath();
  context.moveTo(...from);
  context.lineTo(...to);
  context.stroke();
  if (length < 3) return;
  const u = [(to[0] - from[0]) / length, (to[1] - from[1]) / length];
  const size = Math.min(head, 0.6 * length);
  context.setLineDash([]);
  context.beginPath();
  context.moveTo(...to);
  context.lineTo(to[0] - size * (u[0] + 0.5 * u[1]), to[1] - size * (u[1] - 0.5 * u[0]));
  context.lineTo(to[0] - size * (u[0] - 0.5 * u[1]), to[1] - size * (u[1] + 0.5 * u[0]));
  context.closePath();
  context.fill();
}

function label(context, text, x, y, ink) {
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.lineWidth = 3;
  context.setLineDash([]);
  context.strokeStyle = "#000000b0";
  context.strokeText(text, x, y);
  context.fillStyle = ink;
  context.fillText(text, x, y);
}
