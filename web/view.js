// The canvas: map, paths, scan and car. It is drawn in an animation frame, only after a change.
// What rarely changes (map, grid, plans, spread) is kept as a picture of its own, `back`.

import {find, say} from "./page.js";

const BODY = [-0.06, -0.135, 0.44, 0.27]; // of the car, from its rear axle: x, y, length, width [m]
const WHEELS = [[0, 0.115], [0, -0.115], [0.2965, 0.115], [0.2965, -0.115]]; // ahead, left [m]
const CAR_PIXELS = 16; // the car is drawn at least this long
const DARK = matchMedia("(prefers-color-scheme: dark)");
export const NOTHING = {plan: [], predicted: [], driven: [], scan: [], clicked: [], ellipses: [],
  cloud: [], pose: null, wheels: [0, 0], isStale: false};

export function line(points) {
  const path = new Path2D();
  points.forEach(([x, y]) => path.lineTo(x, y));
  return path;
}

class View {
  constructor(canvas, back) {
    const [pen, backPen] = [canvas, back].map((each) => each.getContext("2d"));
    const style = getComputedStyle(document.documentElement);
    Object.assign(this, NOTHING, {canvas, back, pen, backPen, style, hidden: {}, frames: 0});
    Object.assign(this, {x: 0, y: 0, scale: 40}); // what is in the middle [m]; pixels per metre
    new ResizeObserver(() => this.resize()).observe(canvas);
    DARK.onchange = () => this.set({});
  }

  /** Change what is drawn; with `all`, also what rarely changes. */
  set(values, all = true) {
    Object.assign(this, values);
    this.isBackOld ||= all;
    this.request ||= requestAnimationFrame(() => this.draw());
  }

  resize() {
    const {clientWidth: width, clientHeight: height} = this.canvas;
    const ratio = Math.min(devicePixelRatio, 2);
    for (const each of [this.canvas, this.back]) {
      Object.assign(each, {width: width * ratio, height: height * ratio});
    }
    this.set({width, height, ratio});
  }

  toMap(px, py) {
    const {x, y, scale, width, height} = this;
    return [x + (px - width / 2) / scale, y - (py - height / 2) / scale];
  }

  move(x, y, scale = this.scale) {
    this.set({x, y, scale: Math.min(Math.max(scale, 0.5), 2000)});
  }

  /** Zoom; what is at the pixel (px, py) of the canvas stays there. */
  zoom(factor, px = this.width / 2, py = this.height / 2) {
    const [x, y] = this.toMap(px, py);
    this.move(this.x, this.y, this.scale * factor);
    const [newX, newY] = this.toMap(px, py);
    this.move(this.x + x - newX, this.y + y - newY);
  }

  /** Show all of these points. */
  fit(points) {
    const [[left, right], [bottom, top]] = [0, 1].map((axis) => points.reduce(([low, high], each) =>
      [Math.min(low, each[axis]), Math.max(high, each[axis])], [Infinity, -Infinity]));
    const scale = Math.min(this.width / (right - left + 1.5), this.height / (top - bottom + 1.5));
    this.move((left + right) / 2, (bottom + top) / 2, scale);
  }

  /** Let a pen draw in metres; return the length of a pixel [m]. */
  inMetres(pen) {
    const k = this.scale * this.ratio;
    const {width, height} = this.canvas;
    pen.setTransform(k, 0, 0, -k, width / 2 - k * this.x, height / 2 + k * this.y);
    return 1 / this.scale;
  }

  colour(name) {
    return this.style.getPropertyValue(`--${name}`).trim();
  }

  draw() {
    const {pen, hidden} = this;
    const shown = this.replay ?? this;
    if (this.isBackOld) this.drawBack(this.backPen, shown);
    pen.resetTransform();
    pen.drawImage(this.back, 0, 0);
    if (!hidden.driven) shown.driven.forEach((each) => this.stroke(pen, each, "driven", 3));
    if (!hidden.scan) this.drawDots(pen, shown.scan, "scan", 3);
    if (shown.pose) this.drawCar(pen, shown.pose, shown.wheels, shown.isStale);
    if (this.arrow) this.drawArrow(pen, this.arrow);
    Object.assign(this, {request: 0, frames: this.frames + 1, isBackOld: false});
  }

  drawBack(pen, {predicted, plan, clicked, cloud, ellipses}) {
    const {hidden} = this;
    pen.filter = DARK.matches ? "invert(1)" : "none";
    this.drawMap(pen, this.map);
    pen.filter = "none";
    if (!hidden.grid) this.drawGrid(pen, this.roundLength(30));
    const path = line(predicted.length ? predicted : plan);
    if (!hidden.predicted) this.stroke(pen, path, "predicted", predicted.length ? 4 : 2, [9, 5]);
    if (!hidden.clicked) this.stroke(pen, line(clicked), "clicked", 7, [2, 4]);
    if (!hidden.spread) this.drawDots(pen, cloud, "spread", 2);
    if (!hidden.spread) ellipses.forEach((each) => this.stroke(pen, each, "spread", 2));
    const length = this.roundLength(60);
    say("scale", `${Number(length.toPrecision(1))} m`);
    find("scale").style.width = `${length * this.scale}px`;
  }

  /** The map has the grey values of map_saver. */
  drawMap(pen, map) {
    pen.resetTransform();
    pen.fillStyle = map ? "#cdcdcd" : "#fefefe";
    pen.fillRect(0, 0, this.back.width, this.back.height);
    if (!map || this.hidden.map) return;
    const pixel = this.inMetres(pen) / this.ratio;
    pen.translate(map.origin[0], map.origin[1]);
    pen.rotate(map.origin[2]);
    pen.scale(map.resolution, -map.resolution);
    pen.imageSmoothingEnabled = map.resolution < pixel; // otherwise thin walls vanish
    pen.drawImage(map.picture, 0, -map.height);
  }

  /** The shortest of 1, 2, 5, 10, ... m that has at least so many pixels. */
  roundLength(pixels) {
    const power = 10 ** Math.floor(Math.log10(pixels / this.scale));
    return power * [1, 2, 5, 10].find((each) => each * power * this.scale >= pixels);
  }

  drawGrid(pen, step) {
    const [[left, top], [right, low]] = [this.toMap(0, 0), this.toMap(this.width, this.height)];
    for (let x = Math.ceil(left / step) * step; x < right; x += step) {
      this.stroke(pen, line([[x, low], [x, top]]), "grid", 1);
    }
    for (let y = Math.ceil(low / step) * step; y < top; y += step) {
      this.stroke(pen, line([[left, y], [right, y]]), "grid", 1);
    }
  }

  stroke(pen, path, colour, width, dashes = []) {
    const pixel = this.inMetres(pen);
    pen.lineWidth = width * pixel;
    pen.setLineDash(dashes.map((each) => each * pixel));
    pen.strokeStyle = this.colour(colour);
    pen.stroke(path);
  }

  drawDots(pen, points, colour, pixels) {
    const side = pixels * this.inMetres(pen);
    pen.fillStyle = this.colour(colour);
    points.forEach(([x, y]) => pen.fillRect(x - side / 2, y - side / 2, side, side));
  }

  /** Without a present pose, only the outline is drawn. */
  drawCar(pen, [x, y, theta], steering, isOutline) {
    const k = Math.max(1, (CAR_PIXELS * this.inMetres(pen)) / BODY[2]);
    pen.translate(x, y);
    pen.rotate(theta);
    pen.scale(k, k);
    pen.setLineDash([]);
    pen.lineWidth = 0.02;
    pen.fillStyle = pen.strokeStyle = this.colour("car");
    if (isOutline) return pen.strokeRect(...BODY);
    pen.fillRect(...BODY);
    pen.fillStyle = this.colour("back");
    pen.fill(line([[0.27, 0], [0.16, 0.08], [0.16, -0.08]])); // points ahead
    pen.fillStyle = this.colour("text");
    [0, 0, ...steering].forEach((angle, i) => {
      pen.save();
      pen.translate(...WHEELS[i]);
      pen.rotate(angle);
      pen.fillRect(-0.0488, -0.025, 0.0976, 0.05);
      pen.restore();
    });
  }

  drawArrow(pen, pose) {
    this.drawCar(pen, pose, [], true);
    const pixel = this.inMetres(pen);
    pen.translate(pose[0], pose[1]);
    pen.rotate(pose[2]);
    pen.scale(pixel, pixel);
    pen.lineWidth = 4;
    pen.stroke(line([[0, 0], [70, 0], [56, 9], [56, -9], [70, 0]]));
  }
}

export const view = new View(find("view"), document.createElement("canvas"));
