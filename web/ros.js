// The connection to the bridge (rosbridge protocol v2), which is restored when it is lost.

const RETRY = 1000; // between two attempts to connect [ms]
const DEAD = 5000; // a bridge that does not answer for so long is given up [ms]
const PERIOD = 500; // of the check of the connection [ms]

export const ros = {
  callbacks: {}, calls: {}, callCount: 0,

  /** onOpen(), onError(text), onStatus(isConnected, for how long an answer is due [ms]). */
  start(on) {
    Object.assign(ros, on);
    ros.connect();
    setInterval(ros.check, PERIOD);
  },

  connect() {
    ros.socket = new WebSocket(new URL(".", location.href).href.replace(/^http/, "ws"));
    ros.asked = performance.now(); // when a sign of life was asked for; Infinity if none is due
    ros.socket.onopen = () => {
      ros.asked = Infinity;
      ros.onOpen();
    };
    ros.socket.onmessage = (event) => ros.receive(JSON.parse(event.data));
    ros.socket.onclose = ros.lose;
  },

  lose() {
    ros.socket.onopen = ros.socket.onmessage = ros.socket.onclose = null;
    ros.socket.close();
    Object.values(ros.calls).forEach((each) => each.reject(new Error("the connection was lost")));
    Object.assign(ros, {asked: Infinity, calls: {}});
    ros.onStatus(false, 0);
    setTimeout(ros.connect, RETRY);
  },

  /** Every answer is a sign of life, also that there is no such service. */
  check() {
    const due = Math.max(0, performance.now() - ros.asked);
    if (due > DEAD) return ros.lose();
    if (ros.socket.readyState !== WebSocket.OPEN) return;
    ros.onStatus(true, due);
    if (due) return;
    ros.asked = performance.now();
    ros.call("/rosapi/get_time").catch(() => {}).then(() => (ros.asked = Infinity));
  },

  receive({op, topic, msg, level, id, result, values}) {
    if (op === "publish") ros.callbacks[topic](msg);
    if (op === "status" && level === "error") ros.onError(msg);
    if (op !== "service_response") return;
    if (result) ros.calls[id].resolve(values);
    else ros.calls[id].reject(new Error(String(values)));
    delete ros.calls[id];
  },

  send(msg) {
    if (ros.socket.readyState === WebSocket.OPEN) ros.socket.send(JSON.stringify(msg));
  },

  publish(topic, msg) {
    ros.send({op: "publish", topic, msg});
  },

  /** With a period [ms], messages in between are left out. */
  subscribe(topic, callback, period = 0) {
    ros.callbacks[topic] = callback;
    const limits = period ? {throttle_rate: period, queue_length: 1} : {};
    ros.send({op: "subscribe", id: topic, topic, ...limits});
  },

  /** Call a service without arguments. */
  call(service) {
    const id = `call ${(ros.callCount += 1)}`;
    ros.send({op: "call_service", id, service, args: {}});
    return new Promise((resolve, reject) => (ros.calls[id] = {resolve, reject}));
  },
};
