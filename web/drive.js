// Driving by hand: keys, touch pad and gamepad feed one loop. Commands are sent only while
// something is held, then one stop, then nothing: the mux gives the car back to a plan.

export const SPEED = 2.0; // [m/s]; this and the angle are those of config/keyboard_teleop.yaml
export const ANGLE = 0.34; // [rad]
const PERIOD = 100; // of the commands [ms]
const DEAD_ZONE = 0.1; // of a stick
const KEYS = {w: [1, 0], s: [-1, 0], a: [0, 1], d: [0, -1]}; // forward, left
const PAD_KEYS = {ArrowUp: "w", ArrowDown: "s", ArrowLeft: "a", ArrowRight: "d"};
const TYPING = "input:not([type=checkbox]), select";

export class Hand {
  /** send(speed, angle, device): device is empty for the last stop. */
  constructor(pad, knob, send) {
    Object.assign(this, {pad, knob, send, keys: new Set(), stick: null, isDriving: false});
    addEventListener("keydown", (event) => this.down(event));
    addEventListener("keyup", (event) => this.up(event));
    addEventListener("focusin", (event) => event.target.matches?.(TYPING) && this.stop());
    addEventListener("blur", () => this.stop());
    addEventListener("pagehide", () => this.stop());
    document.addEventListener("visibilitychange", () => this.stop());
    for (const kind of ["pointerdown", "pointermove"]) {
      pad.addEventListener(kind, (event) => this.pull(event));
    }
    for (const kind of ["pointerup", "pointercancel", "lostpointercapture"]) {
      pad.addEventListener(kind, () => this.pull(null));
    }
    setInterval(() => this.step(), PERIOD);
  }

  key(event) {
    return document.activeElement === this.pad && PAD_KEYS[event.key] || event.key.toLowerCase();
  }

  down(event) {
    const key = this.key(event);
    if (!KEYS[key] || event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.target.matches(TYPING)) return;
    event.preventDefault();
    if (event.repeat) return; // after a stop, a key has to be pressed again
    this.keys.add(key);
    this.step();
  }

  up(event) {
    for (const key of [event.key.toLowerCase(), PAD_KEYS[event.key]]) this.keys.delete(key);
    if (this.isDriving) this.step();
  }

  /** The touch pad; null if it is released. */
  pull(event) {
    if (event?.type === "pointerdown") this.pad.setPointerCapture(event.pointerId);
    else if (event && !this.stick) return;
    const half = this.pad.clientWidth / 2;
    const part = (pixels) => Math.max(-1, Math.min(1, (half - pixels) / (half - 22)));
    this.stick = event && [part(event.offsetY), part(event.offsetX)];
    const [ahead, left] = this.stick ?? [0, 0];
    this.knob.style.transform = `translate(${-left * (half - 22)}px, ${-ahead * (half - 22)}px)`;
    if (event?.type !== "pointermove") this.step();
  }

  /** MuSHR's mapping: LB is the deadman button; the axes point down and to the right. */
  gamepad() {
    const pads = document.hasFocus() ? [...navigator.getGamepads()] : [];
    const pad = pads.find((each) => each?.mapping === "standard" && each.buttons[4].pressed);
    const part = (value) => (Math.abs(value) < DEAD_ZONE ? 0 : -value);
    return pad ? [part(pad.axes[1]), part(pad.axes[2])] : null;
  }

  step() {
    const keys = [...this.keys].map((key) => KEYS[key]);
    const sum = keys.reduce((a, b) => [a[0] + b[0], a[1] + b[1]], [0, 0]);
    const gamepad = this.gamepad();
    const device = keys.length ? "keys" : this.stick ? "touch pad" : gamepad ? "gamepad" : "";
    const [ahead, left] = keys.length ? sum : this.stick ?? gamepad ?? [0, 0];
    if (device || this.isDriving) this.send(ahead * SPEED, left * ANGLE, device);
    this.isDriving = Boolean(device);
  }

  stop() {
    this.keys.clear();
    this.pull(null);
  }
}
