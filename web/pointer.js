// The pointer on the canvas (mouse, wheel, pen, touch), and the keys of the focused canvas.

const CLICK = 6; // a press that moves by fewer pixels is a click
const KEYS = {ArrowLeft: [60, 0], ArrowRight: [-60, 0], ArrowUp: [0, 60], ArrowDown: [0, -60]};

export class Pointer {
  /** `on` has the functions pan(), place(x, y, theta or null) and click(x, y). */
  constructor(view, on) {
    Object.assign(this, {view, on, mode: "pan", held: new Map(), start: null, isDrag: false});
    const {canvas} = view;
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.drag(event));
    canvas.addEventListener("pointerup", (event) => this.up(event));
    canvas.addEventListener("pointercancel", (event) => this.release(event));
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      const pixels = event.deltaY * (event.deltaMode ? 30 : 1); // deltaMode 1 counts lines
      view.zoom(Math.exp(-pixels / 400), event.offsetX, event.offsetY);
    }, {passive: false});
  }

  down(event) {
    if (event.button) return;
    this.view.canvas.setPointerCapture(event.pointerId);
    const at = [event.offsetX, event.offsetY];
    this.held.set(event.pointerId, at);
    this.start = this.held.size === 1 ? at : null; // a second finger: neither click nor place
    this.isDrag = false;
    this.view.set({arrow: null}, false);
  }

  drag(event) {
    const last = this.held.get(event.pointerId);
    if (!last) return;
    const now = [event.offsetX, event.offsetY];
    this.isDrag ||= this.start && Math.hypot(now[0] - this.start[0], now[1] - this.start[1]) > CLICK;
    if (this.start && !this.isDrag) return;
    this.held.set(event.pointerId, now);
    if (this.start && this.mode === "place") {
      this.view.set({arrow: this.aim(now)}, false);
    } else {
      const [id] = [...this.held.keys()].filter((each) => each !== event.pointerId);
      if (id !== undefined) this.pinch(this.held.get(id), last, now);
      else this.pan(now[0] - last[0], now[1] - last[1]);
    }
  }

  pinch(other, last, now) {
    const apart = ([x, y]) => Math.max(1, Math.hypot(x - other[0], y - other[1]));
    this.view.zoom(apart(now) / apart(last), ...other);
  }

  pan(right, down) {
    const {x, y, scale} = this.view;
    this.on.pan();
    this.view.move(x - right / scale, y + down / scale);
  }

  /** The pose at the start of the drag, with the heading towards a pixel. */
  aim([px, py]) {
    return [...this.view.toMap(...this.start), Math.atan2(this.start[1] - py, px - this.start[0])];
  }

  up(event) {
    if (this.start && this.mode === "place") {
      const [x, y, theta] = this.aim([event.offsetX, event.offsetY]);
      this.on.place(x, y, this.isDrag ? theta : null);
    } else if (this.start && this.mode === "clicks" && !this.isDrag) {
      this.on.click(...this.view.toMap(...this.start));
    }
    this.release(event);
  }

  release(event) {
    this.held.delete(event.pointerId);
    this.start = null;
    this.view.set({arrow: null}, false);
  }

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (KEYS[event.key]) this.pan(...KEYS[event.key]);
    else if ("+=-".includes(event.key)) this.view.zoom(event.key === "-" ? 1 / 1.3 : 1.3);
    else return;
    event.preventDefault();
  }
}
