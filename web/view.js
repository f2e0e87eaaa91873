// The canvas: map, paths, scan and car. It is drawn in an animation frame, only after a change.
// What rarely changes (map, grid, plans, spread) is kept as a picture of its own, `back`.

import {find, say} from "./page.js";

const BODY = [-0.06, -0.135, 0.44, 0.27]; // of the car, from its rear axle: x, y, length, width [m]
const WHEELS = [[0, 0.115], [0, -0.115], [0.2965, 0.115], [0.2965, -0.115]]; // ahead, left [m]
const CAR_PIXELS = 16; // the car is drawn at least this long
const DARK = matchMedia("(prefers-color-scheme: dark)");
const STYLE = getComputedStyle(document.documentElement);
export const NOTHING = {plan: [], predicted: [], driven: [], scan: [], clicked: [], ellipses: [],
  cloud: [], pose: null, wheels: [0, 0], isStale: false};

const canvas = find("view");
const back = document.createElement("canvas");
const colour = (name) => STYLE.getPropertyValue(`--${name}`).trim();
export function line(points, path = new Path2D()) {
  points.forEach(([x, y]) => path.lineTo(x, y));
  return path;
}

/** x, y: what is in the middle [m]; scale: pixels per metre; hidden: layers. */
export const view = {...NOTHING, canvas, x: 0, y: 0, scale: 40, hidden: {}, frames: 0,
  /** Change what is drawn; with `all`, also what rarely changes. */
  set(values, all = true) {
    Object.assign(view, values);
    view.isBackOld ||= all;
    view.request ||= requestAnimationFrame(draw);
  },

  toMap(px, py) {
    const {x, y, scale, width, height} = view;
    return [x + (px - width / 2) / scale, y - (py - height / 2) / scale];
  },

  move(x, y, scale = view.scale) {
    view.set({x, y, scale: Math.min(Math.max(scale, 0.5), 2000)});
  },

  /** Zoom; what is at the pixel (px, py) of the canvas stays there. */
  zoom(factor, px = view.width / 2, py = view.height / 2) {
    const [x, y] = view.toMap(px, py);
    view.move(view.x, view.y, view.scale * factor);
    const [newX, newY] = view.toMap(px, py);
    view.move(view.x + x - newX, view.y + y - newY);
  },

  /** Show all of these points. */
  fit(points) {
    const [[left, right], [bottom, top]] = [0, 1].map((axis) => points.reduce(([low, high], each) =>
      [Math.min(low, each[axis]), Math.max(high, each[axis])], [Infinity, -Infinity]));
    const scale = Math.min(view.width / (right - left + 1.5), view.height / (top - bottom + 1.5));
    view.move((left + right) / 2, (bottom + top) / 2, scale);
  },
};

function resize() {
  const {clientWidth: width, clientHeight: height} = canvas;
  const ratio = Math.min(devicePixelRatio, 2);
  [canvas, back].forEach((each) =>
    Object.assign(each, {width: width * ratio, height: height * ratio}));
  view.set({width, height, ratio});
}

/** Let a pen draw in metres; return the length of a pixel [m]. */
function inMetres(pen) {
  const k = view.scale * view.ratio;
  pen.setTransform(k, 0, 0, -k, back.width / 2 - k * view.x, back.height / 2 + k * view.y);
  return 1 / view.scale;
}

function draw() {
  const pen = canvas.getContext("2d");
  const {driven, scan, pose, wheels, isStale} = view.replay ?? view;
  if (view.isBackOld) drawBack(back.getContext("2d"), view.replay ?? view);
  pen.resetTransform();
  pen.drawImage(back, 0, 0);
  if (!view.hidden.driven) driven.forEach((each) => stroke(pen, each, "driven", 3));
  if (!view.hidden.scan) drawDots(pen, scan, "scan", 3);
  if (pose) drawCar(pen, pose, wheels, isStale);
  if (view.arrow) drawArrow(pen, view.arrow);
  Object.assign(view, {request: 0, frames: view.frames + 1, isBackOld: false});
}

function drawBack(pen, {predicted, plan, clicked, cloud, ellipses}) {
  const {map, hidden} = view;
  pen.resetTransform();
  pen.filter = DARK.matches ? "invert(1)" : "none";
  pen.fillStyle = map ? "#cdcdcd" : "#fefefe"; // grey values of map_saver, as in the map
  pen.fillRect(0, 0, back.width, back.height);
  if (map && !hidden.map) drawMap(pen, map);
  pen.filter = "none";
  if (!hidden.grid) drawGrid(pen, roundLength(30));
  const isPredicted = predicted.length > 0;
  const path = line(isPredicted ? predicted : plan);
  if (!hidden.predicted) stroke(pen, path, "predicted", isPredicted ? 4 : 2, [9, 5]);
  if (!hidden.clicked) stroke(pen, line(clicked), "clicked", 7, [2, 4]);
  if (!hidden.spread) drawDots(pen, cloud, "spread", 2);
  if (!hidden.spread) ellipses.forEach((each) => stroke(pen, each, "spread", 2));
  say("scale", `${Number(roundLength(60).toPrecision(1))} m`);
  find("scale").style.width = `${roundLength(60) * view.scale}px`;
}

function drawMap(pen, {picture, origin: [x, y, theta], resolution, height}) {
  pen.imageSmoothingEnabled = resolution < inMetres(pen) / view.ratio; // keeps thin walls
  pen.translate(x, y);
  pen.rotate(theta);
  pen.scale(resolution, -resolution);
  pen.drawImage(picture, 0, -height);
}

/** The shortest of 1, 2, 5, 10, ... m that has at least so many pixels. */
function roundLength(pixels) {
  const power = 10 ** Math.floor(Math.log10(pixels / view.scale));
  return power * [1, 2, 5, 10].find((each) => each * power * view.scale >= pixels);
}

function drawGrid(pen, step) {
  const [[left, top], [right, low]] = [view.toMap(0, 0), view.toMap(view.width, view.height)];
  const grid = new Path2D();
  for (let x = left - (left % step); x < right; x += step) grid.rect(x, low, 0, top - low);
  for (let y = low - (low % step); y < top; y += step) grid.rect(left, y, right - left, 0);
  stroke(pen, grid, "grid", 1);
}

function stroke(pen, path, name, width, dashes = []) {
  const pixel = inMetres(pen);
  pen.setLineDash(dashes.map((each) => each * pixel));
  Object.assign(pen, {lineWidth: width * pixel, strokeStyle: colour(name)});
  pen.stroke(path);
}

function drawDots(pen, points, name, pixels) {
  const side = pixels * inMetres(pen);
  pen.fillStyle = colour(name);
  points.forEach(([x, y]) => pen.fillRect(x - side / 2, y - side / 2, side, side));
}

/** Without a present pose, only the outline is drawn. */
function drawCar(pen, [x, y, theta], steering, isOutline) {
  const k = Math.max(1, (CAR_PIXELS * inMetres(pen)) / BODY[2]);
  pen.setLineDash([]);
  pen.translate(x, y);
  pen.rotate(theta);
  pen.scale(k, k);
  Object.assign(pen, {lineWidth: 0.02, fillStyle: colour("car"), strokeStyle: colour("car")});
  if (isOutline) return pen.strokeRect(...BODY);
  pen.fillRect(...BODY);
  pen.fillStyle = colour("back");
  pen.fill(line([[0.27, 0], [0.16, 0.08], [0.16, -0.08]])); // points ahead
  pen.fillStyle = colour("text");
  [0, 0, ...steering].forEach((angle, i) => {
    pen.save();
    pen.translate(...WHEELS[i]);
    pen.rotate(angle);
    pen.fillRect(-0.0488, -0.025, 0.0976, 0.05);
    pen.restore();
  });
}

function drawArrow(pen, [x, y, theta]) {
  drawCar(pen, [x, y, theta], [], true);
  const pixel = inMetres(pen);
  pen.translate(x, y);
  pen.rotate(theta);
  pen.scale(pixel, pixel);
  pen.lineWidth = 4;
  pen.stroke(line([[0, 0], [70, 0], [56, 9], [56, -9], [70, 0]]));
}

new ResizeObserver(resize).observe(canvas);
DARK.onchange = () => view.set({});
