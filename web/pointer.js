// The pointer on the canvas (mouse, wheel, pen, touch), and the keys of the focused canvas.

import {view} from "./view.js";

const CLICK = 6; // a press that moves by fewer pixels is a click
const KEYS = {ArrowLeft: [60, 0], ArrowRight: [-60, 0], ArrowUp: [0, 60], ArrowDown: [0, -60]};
const ZOOM_KEYS = {"+": 1.4, "=": 1.4, "-": 1 / 1.4};
/** Set by main.js: the mode, and the functions onPan(), onPlace(x, y, theta), onClick(x, y). */
export const pointer = {mode: "pan"};
const {canvas} = view;
const held = new Map(); // pixels, by the number of the pointer
let start = null; // of the only pointer
let isDrag = false;

function pan(right, down) {
  pointer.onPan();
  view.set({x: view.x - right / view.scale, y: view.y + down / view.scale});
}

/** The pose where the pointer was pressed, with the heading towards a pixel. */
const aim = (x, y) => [...view.toMap(...start), Math.atan2(start[1] - y, x - start[0])];

canvas.onpointerdown = ({button, pointerId, offsetX, offsetY}) => {
  if (button) return;
  canvas.setPointerCapture(pointerId);
  held.set(pointerId, [offsetX, offsetY]);
  start = held.size === 1 ? [offsetX, offsetY] : null; // two fingers only zoom
  isDrag = false;
};
canvas.onpointermove = ({pointerId, offsetX: x, offsetY: y}) => {
  const apart = (one, other) => Math.max(1, Math.hypot(one[0] - other[0], one[1] - other[1]));
  const last = held.get(pointerId);
  isDrag ||= !start || apart([x, y], start) > CLICK;
  if (!last || !isDrag) return;
  held.set(pointerId, [x, y]);
  const [other] = [...held].filter(([id]) => id !== pointerId).map(([, at]) => at);
  if (other) view.zoom(apart([x, y], other) / apart(last, other), ...other);
  else if (start && pointer.mode === "place") view.set({arrow: aim(x, y)}, false);
  else pan(x - last[0], y - last[1]);
};
canvas.onpointerup = canvas.onpointercancel = ({type, pointerId, offsetX, offsetY}) => {
  const mode = start && type === "pointerup" && pointer.mode;
  const [x, y, theta] = start ? aim(offsetX, offsetY) : [];
  if (mode === "place") pointer.onPlace(x, y, isDrag ? theta : undefined);
  if (mode === "clicks" && !isDrag) pointer.onClick(x, y);
  held.delete(pointerId);
  start = null;
  view.set({arrow: null}, false);
};
canvas.onkeydown = (event) => {
  if (event.ctrlKey || !(KEYS[event.key] || ZOOM_KEYS[event.key])) return;
  event.preventDefault();
  if (KEYS[event.key]) pan(...KEYS[event.key]);
  else view.zoom(ZOOM_KEYS[event.key]);
};
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  const pixels = event.deltaY * (event.deltaMode ? 30 : 1); // deltaMode 1 counts lines
  view.zoom(Math.exp(-pixels / 400), event.offsetX, event.offsetY);
}, {passive: false});
