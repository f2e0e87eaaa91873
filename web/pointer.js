// The pointer on the canvas (mouse, wheel, pen, touch), and the keys of the focused canvas.

import {view} from "./view.js";

const CLICK = 6; // a press that moves by fewer pixels is a click
const KEYS = {ArrowLeft: [60, 0], ArrowRight: [-60, 0], ArrowUp: [0, 60], ArrowDown: [0, -60]};

/** Set by main.js: the mode, and the functions onPan(), onPlace(x, y, theta), onClick(x, y). */
export const pointer = {mode: "pan"};
const held = new Map(); // pixels, by the number of the pointer
let start = null; // of the only pointer
let isDrag = false;

function pan(right, down) {
  pointer.onPan();
  view.move(view.x - right / view.scale, view.y + down / view.scale);
}

/** The pose where the pointer was pressed, with the heading towards a pixel. */
const aim = (x, y) => [...view.toMap(...start), Math.atan2(start[1] - y, x - start[0])];

function drag({pointerId, offsetX: x, offsetY: y}) {
  const apart = (one, other) => Math.hypot(one[0] - other[0], one[1] - other[1]);
  const last = held.get(pointerId);
  isDrag ||= !start || apart([x, y], start) > CLICK;
  if (!last || !isDrag) return;
  held.set(pointerId, [x, y]);
  const [other] = [...held].filter(([id]) => id !== pointerId).map(([, at]) => at);
  if (other) view.zoom(apart([x, y], other) / Math.max(1, apart(last, other)), ...other);
  else if (start && pointer.mode === "place") view.set({arrow: aim(x, y)}, false);
  else pan(x - last[0], y - last[1]);
}

function release({type, pointerId, offsetX, offsetY}) {
  const isDone = start && type === "pointerup";
  const [x, y, theta] = isDone ? aim(offsetX, offsetY) : [];
  if (isDone && pointer.mode === "place") pointer.onPlace(x, y, isDrag ? theta : undefined);
  if (isDone && pointer.mode === "clicks" && !isDrag) pointer.onClick(x, y);
  held.delete(pointerId);
  start = null;
  view.set({arrow: null}, false);
}

view.canvas.onpointerdown = ({button, pointerId, offsetX, offsetY}) => {
  if (button) return;
  view.canvas.setPointerCapture(pointerId);
  held.set(pointerId, [offsetX, offsetY]);
  start = held.size === 1 ? [offsetX, offsetY] : null; // two fingers only zoom
  isDrag = false;
};
view.canvas.onpointermove = drag;
view.canvas.onpointerup = view.canvas.onpointercancel = release;
view.canvas.onkeydown = (event) => {
  const isZoom = ["+", "=", "-"].includes(event.key);
  if (event.ctrlKey || !(isZoom || KEYS[event.key])) return;
  event.preventDefault();
  if (isZoom) view.zoom(event.key === "-" ? 1 / 1.4 : 1.4);
  else pan(...KEYS[event.key]);
};
view.canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  const pixels = event.deltaY * (event.deltaMode ? 30 : 1); // deltaMode 1 counts lines
  view.zoom(Math.exp(-pixels / 400), event.offsetX, event.offsetY);
}, {passive: false});
