// The connection to the bridge (rosbridge protocol v2), which is restored when it is lost.

const RETRY = 1000; // between two attempts to connect [ms]
const DEAD = 5000; // a bridge that does not answer for so long is given up [ms]
const CHECK_PERIOD = 500; // [ms]

class Ros {
  callbacks = {};
  calls = new Map();
  callCount = 0;
  asked = 0; // when a sign of life was asked for, 0 if none is due [ms]

  /** onOpen(), onError(text), onStatus(isConnected, how long an answer is due [ms]). */
  start(on) {
    this.on = on;
    this.connect();
    setInterval(() => this.check(), CHECK_PERIOD);
  }

  connect() {
    const socket = new WebSocket(new URL(".", location.href).href.replace(/^http/, "ws"));
    Object.assign(this, {socket, asked: performance.now()});
    socket.onopen = () => {
      this.asked = 0;
      this.on.onOpen();
    };
    socket.onmessage = (event) => this.receive(JSON.parse(event.data));
    socket.onclose = () => this.lose();
  }

  lose() {
    this.socket.onopen = this.socket.onmessage = this.socket.onclose = null;
    this.socket.close();
    this.asked = 0;
    this.calls.forEach(({reject}) => reject(new Error("the connection was lost")));
    this.calls.clear();
    this.on.onStatus(false, 0);
    setTimeout(() => this.connect(), RETRY);
  }

  /** Ask for a sign of life. Every answer is one, also that there is no such service. */
  check() {
    const due = this.asked ? performance.now() - this.asked : 0;
    if (due > DEAD) return this.lose();
    if (this.socket.readyState !== WebSocket.OPEN) return;
    this.on.onStatus(true, due);
    this.asked ||= performance.now();
    if (!due) this.call("/rosapi/get_time").catch(() => {}).then(() => (this.asked = 0));
  }

  receive({op, topic, msg, level, id, result, values}) {
    if (op === "publish") this.callbacks[topic](msg);
    if (op === "status" && level === "error") this.on.onError(msg);
    if (op !== "service_response") return;
    const {resolve, reject} = this.calls.get(id);
    this.calls.delete(id);
    if (result) resolve(values);
    else reject(new Error(String(values)));
  }

  send(msg) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(msg));
  }

  publish(topic, msg) {
    this.send({op: "publish", topic, msg});
  }

  /** With a period [ms], messages in between are left out. */
  subscribe(topic, callback, period = 0) {
    this.callbacks[topic] = callback;
    const limits = period ? {throttle_rate: period, queue_length: 1} : {};
    this.send({op: "subscribe", id: topic, topic, ...limits});
  }

  /** Call a service without arguments. */
  call(service) {
    const id = `call ${(this.callCount += 1)}`;
    this.send({op: "call_service", id, service, args: {}});
    return new Promise((resolve, reject) => this.calls.set(id, {resolve, reject}));
  }
}

export const ros = new Ros();

export const seconds = ({secs, nsecs}) => secs + nsecs / 1e9;

/** A pose of geometry_msgs as [x, y, theta]. */
export const flat = ({position: {x, y}, orientation: {z, w}}) =>
  [x, y, Math.atan2(2 * w * z, 1 - 2 * z * z)];
