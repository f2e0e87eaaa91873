// Driving by hand: keys, touch pad and gamepad feed one loop. Commands are sent only while
// something is held, then one stop, then nothing: the mux gives the car back to a plan.

import { find, say, server } from "./page.js";
import * as ros from "./ros.js";

const PERIOD = 100; // of the commands [ms]
const DEAD_ZONE = 0.1; // of a gamepad's stick
const KEYS = { w: [1, 0], s: [-1, 0], a: [0, 1], d: [0, -1] }; // forward, left
const PAD_KEYS = {
  ArrowUp: KEYS.w,
  ArrowDown: KEYS.s,
  ArrowLeft: KEYS.a,
  ArrowRight: KEYS.d,
};
const TYPING = "input:not([type=checkbox], [type=radio]), select";
const pad = find("pad");
// What the held keys ask for, by their places on the keyboard: a modifier changes the name of a key.
const keys = new Map();
let stick = null; // of the touch pad: forward, left
let isDriven = false; // whether the last command was no stop
let isArmed = true; // after a stop, the gamepad's button has to be pressed again

/** MuSHR's mapping: LB is the deadman button. The axes point down and to the right. */
function gamepad() {
  const pads = document.hasFocus() ? [...navigator.getGamepads()] : [];
  const held = pads.find(
    (each) =>
      each?.connected && each.mapping === "standard" && each.buttons[4].pressed,
  );
  isArmed ||= !held;
  const part = (value) => (Math.abs(value) < DEAD_ZONE ? 0 : -value);
  return held && isArmed && [part(held.axes[1]), part(held.axes[2])];
}
function heldKeys() {
  const sum = (axis) =>
    [...keys.values()].reduce((total, each) => total + each[axis], 0);
  return keys.size && [sum(0), sum(1)];
}
const INPUTS = { keys: heldKeys, "touch pad": () => stick, gamepad };

/** The first input that asks for something, and [forward, left]. One that fails asks for nothing. */
function wanted() {
  for (const [name, read] of Object.entries(INPUTS)) {
    try {
      const values = read();
      if (values && values.every(Number.isFinite)) return [name, values];
    } catch {
      // Some browsers have no gamepads, or forbid them.
    }
  }
  return ["", [0, 0]];
}

function step() {
  const [device, [ahead, left]] = wanted();
  const { car_name: car, hand } = server.state ?? { hand: {} };
  const speed = ahead * hand.speed;
  const angle = left * hand.steering_angle;
  if (car && (device || isDriven))
    ros.publish(`/${car}/mux/ackermann_cmd_mux/input/teleop`, {
      header: { frame_id: `${car}/base_footprint` },
      drive: { speed, steering_angle: angle },
    });
  isDriven = device !== "";
  say(
    "hand-state",
    device
      ? `${device}: ${speed.toFixed(2)} m/s, ${angle.toFixed(2)} rad`
      : car
        ? `at most ${hand.speed.toFixed(2)} m/s, ${hand.steering_angle.toFixed(2)} rad`
        : "",
  );
}
/** Follow the pointer on the pad; null if it is released. */
function pull(event) {
  const part = (pixels) =>
    Math.max(-1, Math.min(1, 1 - (2 * pixels) / pad.clientWidth));
  stick = event && [part(event.offsetY), part(event.offsetX)];
  const [ahead, left] = stick ?? [0, 0];
  find("knob").style.transform = `translate(${-left * 42}px, ${-ahead * 42}px)`;
  if (event?.type !== "pointermove") step();
}
export function stopHand() {
  keys.clear();
  isArmed = false;
  pull(null);
}
// Any key that does not drive stops the car: a system can swallow the release of a held key, for
// example while Cmd is down.
addEventListener("keydown", (event) => {
  if (event.target.matches(TYPING)) return;
  const { key, code, ctrlKey, altKey, metaKey } = event;
  const isCombined =
    ctrlKey || altKey || metaKey || event.getModifierState("AltGraph");
  const effect =
    (event.target === pad && PAD_KEYS[key]) || KEYS[key.toLowerCase()];
  if (isCombined || !effect) return stopHand();
  event.preventDefault();
  if (!event.repeat) keys.set(code, effect); // after a stop, a key has to be pressed again
});
addEventListener("keyup", ({ code }) => keys.delete(code));
addEventListener(
  "focusin",
  (event) => event.target.matches(TYPING) && stopHand(),
);
for (const each of ["blur", "pagehide", "visibilitychange", "contextmenu"])
  addEventListener(each, stopHand);
pad.onpointerdown = (event) => {
  if (event.button) return;
  pad.setPointerCapture(event.pointerId);
  pull(event);
};
pad.onpointermove = (event) => stick && pull(event.buttons ? event : null);
pad.onlostpointercapture = () => pull(null);
pad.oncontextmenu = (event) => {
  event.stopPropagation(); // a finger that rests on the pad is not a right click
  return false;
};
setInterval(step, PERIOD);
