// The pointer on the canvas (mouse, wheel, pen, touch), and the keys of the focused canvas.

import { find, say, server } from "./page.js";
import * as ros from "./ros.js";
import { view } from "./view.js";

const CLICK = 6; // a press that moves by fewer pixels is a click
const KEYS = {
  ArrowLeft: [60, 0],
  ArrowRight: [-60, 0],
  ArrowUp: [0, 60],
  ArrowDown: [0, -60],
};
const ZOOM_KEYS = { "+": 1.4, "=": 1.4, "-": 1 / 1.4 };
const { canvas } = view;
const held = new Map(); // pixels, by the number of the pointer
let start = null; // of the only pointer
let isDrag = false;

function pan(right, down) {
  find("follow").checked = false;
  const { x, y, scale } = view;
  view.set({ x: x - right / scale, y: y + down / scale }, false);
}
const click = (x, y) =>
  ros.publish(`${server.state?.prefix}/clicked_point`, {
    header: { frame_id: "map" },
    point: { x, y, z: 0 },
  });
/** Without a heading, the car keeps its own. */
export function place(x, y, theta = view.pose?.[2] ?? 0) {
  const orientation = {
    x: 0,
    y: 0,
    z: Math.sin(theta / 2),
    w: Math.cos(theta / 2),
  };
  const pose = { pose: { position: { x, y, z: 0 }, orientation } };
  ros.publish(server.state?.initial_pose_topic, {
    header: { frame_id: "map" },
    pose,
  });
  [x, y, theta].forEach(
    (value, i) => (find("pose-form")[i].value = value.toFixed(3)),
  );
}
/** The pose where the pointer was pressed, with the heading towards a pixel. */
const aim = (x, y) => [
  ...view.toMap(...start),
  Math.atan2(start[1] - y, x - start[0]),
];

canvas.onpointerdown = ({ button, pointerId, offsetX, offsetY }) => {
  if (button) return;
  showPoint(offsetX, offsetY);
  canvas.setPointerCapture(pointerId);
  held.set(pointerId, [offsetX, offsetY]);
  start = held.size === 1 ? [offsetX, offsetY] : null; // two fingers only zoom
  isDrag = false;
};
/** Show the coordinates of a pixel. */
function showPoint(px, py) {
  const [x, y] = view.toMap(px, py).map((each) => each.toFixed(2));
  say("pointer", `x ${x} m, y ${y} m`);
}
canvas.onpointermove = ({ pointerId, offsetX: x, offsetY: y }) => {
  showPoint(x, y);
  const apart = (one, other) =>
    Math.max(1, Math.hypot(one[0] - other[0], one[1] - other[1]));
  const last = held.get(pointerId);
  isDrag ||= !start || apart([x, y], start) > CLICK;
  if (!last || !isDrag) return;
  held.set(pointerId, [x, y]);
  const [other] = [...held]
    .filter(([id]) => id !== pointerId)
    .map(([, at]) => at);
  if (other) view.zoom(apart([x, y], other) / apart(last, other), ...other);
  else if (start && find("place").checked)
    view.set({ arrow: aim(x, y) }, false);
  else pan(x - last[0], y - last[1]);
};
canvas.onpointerup = canvas.onpointercancel = ({
  type,
  pointerId,
  offsetX,
  offsetY,
}) => {
  const isDone = start && type === "pointerup";
  const [x, y, theta] = isDone ? aim(offsetX, offsetY) : [];
  if (isDone && find("place").checked) place(x, y, isDrag ? theta : undefined);
  if (isDone && find("clicks").checked && !isDrag) click(x, y);
  held.delete(pointerId);
  start = null;
  view.set({ arrow: null }, false);
};
canvas.onkeydown = ({ key, ctrlKey }) => {
  if (KEYS[key]) pan(...KEYS[key]);
  if (ZOOM_KEYS[key] && !ctrlKey) view.zoom(ZOOM_KEYS[key]);
  return !KEYS[key]; // false: the page does not scroll
};
canvas.onwheel = ({ deltaY, deltaMode, offsetX, offsetY }) => {
  view.zoom(Math.exp((-deltaY * (deltaMode ? 30 : 1)) / 400), offsetX, offsetY); // 1: lines
  return false;
};
