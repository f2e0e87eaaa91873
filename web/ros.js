// The connection to the bridge (rosbridge protocol v2), which is restored when it is lost.

const PERIOD = 500; // of the check of the connection [ms]
const RETRY = 1000; // between two attempts to connect [ms]
const DEAD = 5000; // a bridge that does not answer for this long is given up [ms]

export class Ros {
  /** onStatus(isConnected, delay): for how long an answer of the bridge is due [ms]. */
  constructor(onStatus) {
    Object.assign(this, {onStatus, callbacks: new Map(), calls: new Map(), calledCount: 0});
    this.connect();
    setInterval(() => this.check(), PERIOD);
  }

  get isConnected() {
    return this.socket.readyState === WebSocket.OPEN;
  }

  connect() {
    this.asked = performance.now();
    this.socket = new WebSocket(new URL(".", location.href).href.replace(/^http/, "ws"));
    this.socket.onopen = () => {
      this.asked = 0;
      this.callbacks.clear();
      this.onOpen();
      this.onStatus(true, 0);
    };
    this.socket.onmessage = (event) => this.receive(JSON.parse(event.data));
    this.socket.onclose = () => this.lose();
  }

  lose() {
    this.socket.onopen = this.socket.onmessage = this.socket.onclose = null;
    this.socket.close();
    this.asked = 0;
    this.calls.forEach((call) => call.reject(new Error("the connection was lost")));
    this.calls.clear();
    this.onStatus(false, 0);
    setTimeout(() => this.connect(), RETRY);
  }

  /** Ask for a sign of life. Every answer is one, also that there is no such service. */
  check() {
    const waited = this.asked ? performance.now() - this.asked : 0;
    if (waited > DEAD) this.lose();
    else if (this.isConnected) this.onStatus(true, waited);
    if (this.asked || !this.isConnected) return;
    this.asked = performance.now();
    this.call("/rosapi/get_time").catch(() => {}).then(() => (this.asked = 0));
  }

  receive(msg) {
    const call = this.calls.get(msg.id);
    if (msg.op === "publish") this.callbacks.get(msg.topic)?.(msg.msg);
    else if (msg.op === "status" && msg.level === "error") this.onError?.(msg.msg);
    if (msg.op !== "service_response" || !call) return;
    this.calls.delete(msg.id);
    if (msg.result) call.resolve(msg.values);
    else call.reject(new Error(String(msg.values)));
  }

  send(msg) {
    if (this.isConnected) this.socket.send(JSON.stringify(msg));
    return this.isConnected;
  }

  /** With a period [ms], messages in between are left out. Valid until the connection is lost. */
  subscribe(topic, callback, period = 0) {
    this.callbacks.set(topic, callback);
    const limits = period ? {throttle_rate: period, queue_length: 1} : {};
    this.send({op: "subscribe", id: topic, topic, ...limits});
  }

  publish(topic, msg) {
    return this.send({op: "publish", topic, msg});
  }

  /** Call a service without arguments. */
  call(service) {
    const id = `call ${(this.calledCount += 1)}`;
    return new Promise((resolve, reject) => {
      if (!this.send({op: "call_service", id, service, args: {}})) reject(new Error("not connected"));
      else this.calls.set(id, {resolve, reject});
    });
  }
}

/** GET, POST or DELETE; returns the JSON of the answer, or throws what is wrong. */
export async function request(path, method = "GET", body = undefined) {
  const headers = body && {"Content-Type": "application/json"};
  const options = {method, headers, body: body && JSON.stringify(body), cache: "no-store"};
  const answer = await fetch(path, options).catch(() => null);
  if (!answer) throw new Error("the server does not answer");
  const data = await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Error(data.error || `the server answers with status ${answer.status}`);
  return data;
}

export const seconds = (stamp) => stamp.secs + stamp.nsecs / 1e9;

/** A pose of geometry_msgs as [x, y, theta]. */
export function flat({position: {x, y}, orientation: {z, w}}) {
  return [x, y, Math.atan2(2 * w * z, 1 - 2 * z * z)];
}
