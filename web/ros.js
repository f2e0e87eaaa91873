// The connection to the bridge (rosbridge protocol v2), which is restored when it is lost.

const PERIOD = 500; // of the check of the connection [ms]
const RETRY = 1000; // between two attempts to connect [ms]
const DEAD = 5000; // a bridge that sends nothing for so long is given up [ms]
const callbacks = {}; // by topic
const calls = new Map(); // the functions that take the answers, by id
let on; // the functions onOpen(), onError(text), onStatus(isConnected, delay of an answer [ms])
let socket;
let asked; // when a sign of life was asked for [ms]; Infinity if none is due
let heard; // when the last message arrived [ms]; on a busy machine, an answer may take longer

const send = (msg) =>
  socket.readyState === WebSocket.OPEN && socket.send(JSON.stringify(msg));
export const publish = (topic, msg) => send({ op: "publish", topic, msg });
/** With a period [ms], messages in between are left out. */
export function subscribe(topic, callback, period = 0) {
  callbacks[topic] = callback;
  const limits = period ? { throttle_rate: period, queue_length: 1 } : {};
  send({ op: "subscribe", id: topic, topic, ...limits });
}
/** Call a service of std_srvs/Trigger; the promise's {success, message} has its answer. */
export function call(service) {
  const id = `${service} ${Math.random()}`;
  send({ op: "call_service", id, service, args: {} });
  return new Promise((answer) => calls.set(id, answer));
}

function receive({ op, topic, msg, level, id, result, values }) {
  if (op === "publish") callbacks[topic](msg);
  if (op === "status" && level === "error") on.onError(msg);
  if (op === "service_response")
    calls.get(id)(result ? values : { message: String(values) });
  calls.delete(id);
}

function connect() {
  asked = heard = performance.now();
  socket = new WebSocket(
    new URL(".", location.href).href.replace(/^http/, "ws"),
  );
  socket.onmessage = (event) => {
    heard = performance.now();
    receive(JSON.parse(event.data));
  };
  socket.onclose = lose;
  socket.onopen = () => {
    asked = Infinity;
    on.onOpen();
    check();
  };
}
function lose() {
  socket.onopen = socket.onmessage = socket.onclose = null;
  socket.close();
  asked = Infinity;
  calls.forEach((answer) => answer({ message: "the connection was lost" }));
  calls.clear();
  on.onStatus(false, 0);
  setTimeout(connect, RETRY);
}
/** Every answer is a sign of life, also that there is no such service. */
function check() {
  const now = performance.now();
  const delay = Math.max(0, now - asked);
  if (delay > DEAD && now - heard > DEAD) return lose();
  if (socket.readyState !== WebSocket.OPEN) return;
  on.onStatus(true, delay);
  if (delay) return;
  asked = now;
  call("/rosapi/get_time").then(() => (asked = Infinity));
}

export function start(functions) {
  on = functions;
  connect();
  setInterval(check, PERIOD);
}
