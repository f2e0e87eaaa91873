// The canvas: map, paths, scan and car. It is drawn in an animation frame, only after a change.
// What rarely changes (map, grid, plans, spread) is kept as a picture of its own, `back`.

const CAR = {rear: -0.06, front: 0.38, side: 0.135, wheelbase: 0.2965, track: 0.23, wheel: 0.0488};
const CAR_PIXELS = 16; // the car is drawn at least this long
const [MIN_SCALE, MAX_SCALE] = [0.5, 2000]; // pixels per metre
const COLOURS = ["back", "text", "wall", "free", "unknown", "grid", "driven", "predicted", "scan",
  "clicked", "spread", "car", "tyre"];

export function line(points) {
  const path = new Path2D();
  points.forEach(([x, y]) => path.lineTo(x, y));
  return path;
}

export class View {
  constructor(canvas) {
    this.canvas = canvas;
    this.pen = canvas.getContext("2d", {alpha: false});
    this.back = document.createElement("canvas");
    this.backPen = this.back.getContext("2d", {alpha: false});
    Object.assign(this, {x: 0, y: 0, scale: 40, ratio: 1, frames: 0, hidden: {}, map: null});
    Object.assign(this, {plan: [], arrow: null, replay: null});
    this.forget();
    new ResizeObserver(() => this.resize()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.colour());
    this.colour();
  }

  /** Remove all that the bridge has sent. */
  forget() {
    this.set({driven: new Map(), predicted: [], scan: [], clicked: [], ellipses: [], cloud: [],
      pose: null, wheels: [0, 0], isStale: false});
  }

  /** Change what is drawn; with `all`, also what rarely changes. */
  set(values, all = true) {
    Object.assign(this, values);
    this.isBackOld ||= all;
    this.request ||= requestAnimationFrame(() => this.draw());
  }

  colour() {
    const style = getComputedStyle(document.documentElement);
    const pairs = COLOURS.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]);
    this.colours = Object.fromEntries(pairs);
    this.paintMap();
  }

  resize() {
    this.ratio = Math.min(devicePixelRatio, 2);
    for (const each of [this.canvas, this.back]) {
      each.width = Math.max(1, Math.round(this.canvas.clientWidth * this.ratio));
      each.height = Math.max(1, Math.round(this.canvas.clientHeight * this.ratio));
    }
    this.set({});
  }

  /** Show the map point (x, y) in the middle. */
  move(x, y, scale = this.scale) {
    this.set({x, y, scale: Math.min(Math.max(scale, MIN_SCALE), MAX_SCALE)});
  }

  /** Zoom; the map point at the pixel (px, py) of the canvas stays where it is. */
  zoom(factor, px = this.canvas.clientWidth / 2, py = this.canvas.clientHeight / 2) {
    const [x, y] = this.toMap(px, py);
    const scale = Math.min(Math.max(this.scale * factor, MIN_SCALE), MAX_SCALE);
    const k = this.scale / scale;
    this.move(x + (this.x - x) * k, y + (this.y - y) * k, scale);
  }

  toMap(px, py) {
    const {clientWidth: width, clientHeight: height} = this.canvas;
    return [this.x + (px - width / 2) / this.scale, this.y - (py - height / 2) / this.scale];
  }

  /** Show all of these points; without any, the whole map. */
  fit(points) {
    if (!points.length && this.map) points = this.map.corners;
    if (!points.length) points = [[-5, -5], [5, 5]];
    const [left, bottom] = [0, 1].map((i) => points.reduce((a, p) => Math.min(a, p[i]), Infinity));
    const [right, top] = [0, 1].map((i) => points.reduce((a, p) => Math.max(a, p[i]), -Infinity));
    const {clientWidth: width, clientHeight: height} = this.canvas;
    const scale = Math.min(width / (right - left + 1.5), height / (top - bottom + 1.5));
    this.move((left + right) / 2, (bottom + top) / 2, scale);
  }

  /** `picture`: an ImageBitmap with the grey values of map_saver. */
  setMap(info, picture) {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [info.width, info.height];
    const pen = canvas.getContext("2d", {willReadFrequently: true});
    pen.drawImage(picture, 0, 0);
    const grey = pen.getImageData(0, 0, info.width, info.height).data;
    const [x, y] = info.origin;
    const corners = [[x, y], [x + info.width * info.resolution, y + info.height * info.resolution]];
    this.map = {info, canvas, pen, grey, corners};
    this.paintMap();
  }

  /** Give the map the colours of the page: once for each map and theme. */
  paintMap() {
    if (this.map) {
      const {pen, grey, info} = this.map;
      const [wall, free, unknown] = ["wall", "free", "unknown"].map((name) => {
        const [red, green, blue] = this.colours[name].match(/\w\w/g).map((text) => `0x${text}`);
        return (255 << 24) | (blue << 16) | (green << 8) | red;
      });
      const picture = pen.createImageData(info.width, info.height);
      const pixels = new Uint32Array(picture.data.buffer);
      for (let i = 0; i < pixels.length; i += 1) {
        pixels[i] = grey[4 * i] < 100 ? wall : grey[4 * i] > 230 ? free : unknown;
      }
      pen.putImageData(picture, 0, 0);
    }
    this.set({});
  }

  /** Let a pen draw in metres; return the length of a pixel of the page [m]. */
  inMetres(pen) {
    const k = this.scale * this.ratio;
    const {width, height} = this.canvas;
    pen.setTransform(k, 0, 0, -k, width / 2 - k * this.x, height / 2 + k * this.y);
    return 1 / this.scale;
  }

  draw() {
    this.request = 0;
    this.frames += 1;
    if (this.isBackOld) this.drawBack();
    this.isBackOld = false;
    const {pen, hidden} = this;
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.drawImage(this.back, 0, 0);
    const shown = this.replay ?? this;
    if (!hidden.driven) shown.driven.forEach((path) => this.stroke(pen, path, "driven", 3));
    if (!hidden.scan && !this.replay) this.drawDots(pen, this.scan, "scan", 3);
    if (shown.pose) this.drawCar(pen, shown);
    if (this.arrow) this.drawArrow(pen, this.arrow);
    this.drawScale(pen);
  }

  drawBack() {
    const {backPen: pen, colours, hidden, map} = this;
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.fillStyle = map ? colours.unknown : colours.free;
    pen.fillRect(0, 0, this.back.width, this.back.height);
    if (map && !hidden.map) this.drawMap(pen, map);
    if (!hidden.grid) this.drawGrid(pen);
    const {predicted} = this.replay ?? this;
    if (!hidden.predicted && predicted.length) {
      this.stroke(pen, line(predicted), "predicted", 4, [9, 5]);
    } else if (!hidden.predicted && !this.replay) {
      this.stroke(pen, line(this.plan), "predicted", 2, [6, 6]);
    }
    if (!hidden.clicked && !this.replay) this.stroke(pen, line(this.clicked), "clicked", 7, [2, 4]);
    if (!hidden.spread && !this.replay) this.drawSpread(pen);
  }

  drawMap(pen, {info, canvas}) {
    const pixel = this.inMetres(pen);
    pen.translate(info.origin[0], info.origin[1]);
    pen.rotate(info.origin[2]);
    pen.scale(info.resolution, -info.resolution);
    pen.imageSmoothingEnabled = info.resolution < pixel / this.ratio; // otherwise walls vanish
    pen.drawImage(canvas, 0, -info.height);
  }

  /** The shortest of 1, 2, 5, 10, ... m that has at least so many pixels. */
  round(pixels) {
    const power = 10 ** Math.floor(Math.log10(pixels / this.scale));
    return [1, 2, 5, 10].map((each) => each * power).find((each) => each * this.scale >= pixels);
  }

  drawGrid(pen) {
    const step = this.round(30);
    const {clientWidth: width, clientHeight: height} = this.canvas;
    const [[left, top], [right, bottom]] = [this.toMap(0, 0), this.toMap(width, height)];
    const path = new Path2D();
    for (let x = Math.ceil(left / step) * step; x < right; x += step) {
      path.moveTo(x, bottom);
      path.lineTo(x, top);
    }
    for (let y = Math.ceil(bottom / step) * step; y < top; y += step) {
      path.moveTo(left, y);
      path.lineTo(right, y);
    }
    this.stroke(pen, path, "grid", 1);
  }

  stroke(pen, path, colour, width, dashes = []) {
    const pixel = this.inMetres(pen);
    pen.lineWidth = width * pixel;
    pen.lineJoin = "round";
    pen.setLineDash(dashes.map((each) => each * pixel));
    pen.strokeStyle = this.colours[colour];
    pen.stroke(path);
  }

  /** Squares of so many pixels. */
  drawDots(pen, points, colour, pixels) {
    const side = pixels * this.inMetres(pen);
    pen.fillStyle = this.colours[colour];
    points.forEach(([x, y]) => pen.fillRect(x - side / 2, y - side / 2, side, side));
  }

  drawSpread(pen) {
    this.drawDots(pen, this.cloud, "spread", 2);
    this.ellipses.forEach(({pose: [x, y, theta], size}) => {
      const path = new Path2D();
      path.ellipse(x, y, size.x / 2, size.y / 2, theta, 0, 2 * Math.PI);
      this.stroke(pen, path, "spread", 2);
    });
  }

  /** Without a fresh pose, only its outline is drawn. */
  drawCar(pen, {pose: [x, y, theta], wheels = [0, 0], isStale, touches}) {
    this.inMetres(pen);
    const k = Math.max(1, CAR_PIXELS / ((CAR.front - CAR.rear) * this.scale));
    pen.translate(x, y);
    pen.rotate(theta);
    pen.scale(k, k);
    pen.setLineDash([]);
    pen.lineWidth = 0.02;
    pen.fillStyle = pen.strokeStyle = this.colours.car;
    const body = [CAR.rear, -CAR.side, CAR.front - CAR.rear, 2 * CAR.side];
    if (isStale) return pen.strokeRect(...body);
    pen.fillRect(...body);
    pen.strokeStyle = this.colours.text;
    if (touches) pen.strokeRect(...body);
    pen.fillStyle = this.colours.back; // the windscreen shows which end is the front
    pen.fill(line([[0.3, 0], [0.2, 0.09], [0.2, -0.09]]));
    pen.fillStyle = this.colours.tyre;
    [[0, 1, 0], [0, -1, 0], [CAR.wheelbase, 1, wheels[0]], [CAR.wheelbase, -1, wheels[1]]].forEach(
      ([ahead, side, angle]) => {
        pen.save();
        pen.translate(ahead, side * CAR.track / 2);
        pen.rotate(angle);
        pen.fillRect(-CAR.wheel, -0.025, 2 * CAR.wheel, 0.05);
        pen.restore();
      });
  }

  drawArrow(pen, [x, y, theta]) {
    const [c, s] = [Math.cos(theta) / this.scale, Math.sin(theta) / this.scale];
    const at = (ahead, left) => [x + c * ahead - s * left, y + s * ahead + c * left];
    const path = line([at(0, 0), at(60, 0), at(46, 10), at(46, -10), at(60, 0)]);
    this.stroke(pen, path, "car", 4);
  }

  drawScale(pen) {
    const length = this.round(60);
    pen.setTransform(this.ratio, 0, 0, this.ratio, 12, this.canvas.height - 14);
    pen.fillStyle = this.colours.back;
    pen.fillRect(-6, -20, length * this.scale + 12, 28);
    pen.fillStyle = this.colours.text;
    pen.fillRect(0, 0, length * this.scale, 3);
    pen.font = "13px system-ui, sans-serif";
    pen.fillText(`${length} m`, 0, -6);
  }
}
