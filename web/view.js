// The canvas, drawn in an animation frame after a change. The picture `back` has what rarely
// changes: map, grid, plans. It is larger than the canvas, so that it can be moved.

import { find } from "./page.js";

const BODY = [-0.06, -0.135, 0.44, 0.27]; // of the car, from its rear axle: x, y, length, width [m]
const WHEELS = [
  [0, 0.115],
  [0, -0.115],
  [0.2965, 0.115],
  [0.2965, -0.115],
]; // ahead, left [m]
const ARROW = [
  [0, 0],
  [1.5, 0],
  [1.2, 0.2],
  [1.2, -0.2],
  [1.5, 0],
]; // shows where the car heads
const CAR_PIXELS = 16; // the car is drawn at least this long
const STEP_PIXELS = 45; // the lines of the grid are at least so far apart
const MARGIN = 200; // of `back` around the canvas [pixel]
const DARK = matchMedia("(prefers-color-scheme: dark)");
/** Paths are lists of [x, y] or [x, y, theta]. */
export const NOTHING = {
  predicted: [],
  driven: [],
  scan: [],
  clicked: [],
  pose: null,
  wheels: [0, 0],
  isStale: false,
};
const canvas = find("view");
const back = document.createElement("canvas");
const isShown = (name) => find(`show-${name}`)?.checked ?? true;
const colour = (name) => getComputedStyle(canvas).getPropertyValue(`--${name}`);

/** x, y: what is in the middle [m]; scale: pixels per metre. */
export const view = {
  ...NOTHING,
  canvas,
  plan: [],
  x: 0,
  y: 0,
  scale: 40,
  drawn: [0, 0], // the middle of `back` [m]
  /** Change what is drawn; with `all`, also what rarely changes. */
  set(values, all = true) {
    const isOld = ([name, value]) =>
      `${value}` === `${view[name]}` && !/object/.test(value);
    const isSame =
      Object.keys(values).length && Object.entries(values).every(isOld);
    Object.assign(view, values);
    if (isSame) return; // the car stands
    view.isBackOld ||= all;
    view.request ||= requestAnimationFrame(draw);
  },
  toMap(px, py) {
    const { x, y, scale, width, height } = view;
    return [x + (px - width / 2) / scale, y - (py - height / 2) / scale];
  },
  /** Zoom; what is at the pixel (px, py) of the canvas stays there. */
  zoom(factor, px = view.width / 2, py = view.height / 2) {
    const [x, y] = view.toMap(px, py);
    const scale = Math.min(Math.max(view.scale * factor, 0.5), 2000);
    const k = view.scale / scale;
    view.set({ x: x + (view.x - x) * k, y: y + (view.y - y) * k, scale });
  },
  /** Show all of these points. */
  fit(points) {
    const [[left, right], [low, high]] = [0, 1].map((axis) =>
      points.reduce(
        ([least, most], each) => [
          Math.min(least, each[axis]),
          Math.max(most, each[axis]),
        ],
        [Infinity, -Infinity],
      ),
    );
    const scale = Math.min(
      view.width / (right - left + 1.5),
      view.height / (high - low + 1.5),
    );
    view.set({ x: (left + right) / 2, y: (low + high) / 2, scale });
  },
};
/** Let a pen draw in metres from a pose; return the length of a pixel [m]. */
function inMetres(pen, [x, y, theta] = [0, 0, 0]) {
  const k = view.scale * view.ratio;
  pen.setTransform(
    k,
    0,
    0,
    -k,
    pen.canvas.width / 2 - k * view.x,
    pen.canvas.height / 2 + k * view.y,
  );
  pen.translate(x, y);
  pen.rotate(theta);
  return 1 / view.scale;
}
function draw() {
  view.request = 0;
  if (!view.width || !view.height) return;
  const pen = canvas.getContext("2d");
  const { driven, scan, pose, wheels, isStale } = view;
  const moved = () => [view.drawn[0] - view.x, view.y - view.drawn[1]];
  const margin = MARGIN / view.scale;
  if (view.isBackOld || moved().some((each) => Math.abs(each) > margin)) {
    drawBack(back.getContext("2d"), view);
    view.drawn = [view.x, view.y];
    view.isBackOld = false;
  }
  const [right, down] = moved().map((each) =>
    Math.round((each - margin) * view.scale * view.ratio),
  );
  pen.resetTransform();
  pen.drawImage(back, right, down);
  drawLine(pen, driven, "driven", 3);
  drawDots(pen, scan, "scan", 3);
  if (pose) drawCar(pen, pose, wheels, isStale);
  if (view.arrow) drawCar(pen, view.arrow, [], true);
  if (view.arrow) drawLine(pen, ARROW, "car", 3, [], view.arrow);
  drawAxes(pen, roundLength(STEP_PIXELS));
}
/** Write x below, and y at the left, at the lines of the grid. */
function drawAxes(pen, step) {
  const { width, height, ratio } = view;
  const write = (text, x, y) => {
    pen.strokeText(text, x, y);
    pen.fillText(text, x, y);
  };
  const digits = Math.max(0, -Math.floor(Math.log10(step)));
  const [left, top] = view.toMap(0, 0);
  const [right, low] = view.toMap(width, height);
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.setLineDash([]);
  pen.font = "12px system-ui, sans-serif";
  pen.lineWidth = 4;
  pen.strokeStyle = colour("back");
  pen.fillStyle = colour("text");
  pen.textAlign = "center";
  const margin = 35 / view.scale;
  const within = (from, to) => multiples(step, from + margin, to - margin);
  for (const x of within(left, right - margin))
    write(x.toFixed(digits), (x - left) * view.scale, height - 6);
  write("x [m]", width - 22, height - 6);
  pen.textAlign = "left";
  for (const y of within(low, top))
    write(y.toFixed(digits), 5, (top - y) * view.scale + 4);
  write("y [m]", 5, 14);
}
/** The multiples of a step from a number to another one, without -0. */
function multiples(step, from, to) {
  const first = Math.ceil(from / step);
  const count = Math.max(0, Math.floor(to / step) - first + 1);
  return Array.from({ length: count }, (_, i) => (first + i) * step + 0);
}
function drawBack(pen, { predicted, plan = [], clicked }) {
  pen.resetTransform();
  pen.filter = DARK.matches ? "invert(1)" : "none";
  pen.fillStyle = view.map ? "#cdcdcd" : "#fefefe"; // grey values of map_saver, as in the map
  pen.fillRect(0, 0, back.width, back.height);
  const { picture, origin, resolution, height } = view.map ?? {};
  const pixel = inMetres(pen, origin) / view.ratio;
  pen.imageSmoothingEnabled = resolution < pixel; // otherwise thin walls vanish
  pen.scale(resolution, -resolution);
  if (picture && isShown("map")) pen.drawImage(picture, 0, -height);
  pen.filter = "none";
  pen.globalCompositeOperation = DARK.matches ? "screen" : "multiply"; // walls stay as they are
  drawGrid(pen, roundLength(STEP_PIXELS));
  pen.globalCompositeOperation = "source-over";
  drawLine(pen, plan, "predicted", 2, [9, 5]);
  drawLine(pen, predicted, "predicted", 4, [9, 5]);
  drawLine(pen, clicked, "clicked", 6, [3, 5]);
}
/** The shortest of 1, 2, 5, 10, ... m that has at least so many pixels. */
function roundLength(pixels) {
  const power = 10 ** Math.floor(Math.log10(pixels / view.scale));
  return (
    power * [1, 2, 5, 10].find((each) => each * power * view.scale >= pixels)
  );
}
function drawGrid(pen, step) {
  const [[left, top], [right, low]] = [
    view.toMap(-MARGIN, -MARGIN),
    view.toMap(view.width + MARGIN, view.height + MARGIN),
  ];
  const add = (...points) => drawLine(pen, points, "grid", 1);
  for (const x of multiples(step, left, right)) add([x, low], [x, top]);
  for (const y of multiples(step, low, top)) add([left, y], [right, y]);
}
function drawLine(pen, points, name, width, dashes = [], from = undefined) {
  const pixel = inMetres(pen, from);
  pen.setLineDash(dashes.map((each) => each * pixel));
  pen.lineWidth = width * pixel;
  pen.strokeStyle = colour(name);
  pen.beginPath();
  points.forEach(([x, y]) => pen.lineTo(x, y));
  if (isShown(name)) pen.stroke();
}
function drawDots(pen, points, name, pixels) {
  const side = pixels * inMetres(pen);
  pen.fillStyle = colour(name);
  const shown = isShown(name) ? points : [];
  shown.forEach(([x, y]) =>
    pen.fillRect(x - side / 2, y - side / 2, side, side),
  );
}
/** Without a present pose, only the outline is drawn. */
function drawCar(pen, pose, steering, isOutline) {
  const k = Math.max(1, (CAR_PIXELS * inMetres(pen, pose)) / BODY[2]);
  pen.scale(k, k);
  pen.lineWidth = 0.02;
  pen.fillStyle = pen.strokeStyle = colour("car");
  if (isOutline) return pen.strokeRect(...BODY);
  pen.fillRect(...BODY);
  pen.fillStyle = colour("back");
  pen.fillRect(0.16, -0.09, 0.08, 0.18); // the windscreen shows where the front is
  pen.fillStyle = colour("text");
  [0, 0, ...steering].forEach((angle, i) => {
    pen.save();
    pen.translate(...WHEELS[i]);
    pen.rotate(angle);
    pen.fillRect(-0.0488, -0.025, 0.0976, 0.05);
    pen.restore();
  });
}
function resize() {
  const { clientWidth: width, clientHeight: height } = canvas;
  const ratio = Math.min(devicePixelRatio, 2);
  canvas.width = width * ratio;
  canvas.height = height * ratio;
  back.width = (width + 2 * MARGIN) * ratio;
  back.height = (height + 2 * MARGIN) * ratio;
  view.set({ width, height, ratio });
  view.isBackOld = true;
  draw(); // at once: the new size has cleared the canvas
}
resize();
new ResizeObserver(resize).observe(canvas);
DARK.onchange = () => view.set({});
