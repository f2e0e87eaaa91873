// Connects the parts of the page with the topics and services.

import * as hand from "./drive.js";
import {
  element,
  find,
  flat,
  poseText,
  request,
  say,
  seconds,
  server,
} from "./page.js";
import {
  addError,
  fit,
  isRead,
  listPlans,
  onOutput,
  onStart,
  onVerdict,
  stopPlan,
  updateDrive,
} from "./plan.js";
import { place } from "./pointer.js";
import * as ros from "./ros.js";
import { poseAt, points, SAME } from "./scan.js";
import { NOTHING, view } from "./view.js";

const LATE = 1000; // a pose or an answer of the bridge is late after this time [ms]
let heard = 0; // when a pose came [ms]
let held = Infinity; // when this page held the clock [s]; Infinity if the clock runs
let owner = ""; // the mux input that drives, which the latest mux has published
let checked = ""; // names and times of the plans, the map, the car: on which a check depends
let poses = []; // the last ones: a scan is drawn from the pose of its stamp
let scan = null; // that waits for this pose

/**
 * Called when the connection opens, and twice a second: says what is wrong, without a count, which
 * screen readers would read.
 */
function onStatus(isConnected, delay) {
  if (!isConnected) server.state = null;
  const { state } = server;
  if (!state) updateDrive(undefined);
  if (!state || delay > LATE) hand.stopHand();
  const silence = performance.now() - heard;
  const isStale = !state || (silence > LATE && held === Infinity);
  const cause = !state?.has_car
    ? "no simulated car is running"
    : state.holds_clock
      ? "the clock is held, or the machine is busy"
      : "its poses are late; the machine may be busy";
  say(
    "problem",
    [
      state?.problem,
      delay > LATE && "the server of this page (web_view.py) does not answer",
      state && isStale && `no pose${state.problem ? "" : `: ${cause}`}`,
    ]
      .filter(Boolean)
      .join("; "),
  );
  say(
    "connection",
    isConnected ? "connected" : "not connected: trying again every second",
  );
  find("connection").className = isConnected ? "good" : "";
  view.set({ isStale }, false);
}

function onState(state) {
  const isFirst = !server.state;
  const lastDrive = server.state?.drive;
  const last = checked;
  server.state = state;
  checked = JSON.stringify([state.plans, state.map, state.car, state.has_car]);
  updateDrive(state.drive);
  showOwner();
  find("time-section").hidden = !state.holds_clock;
  if (!isFirst) {
    if (state.map !== (view.map?.number ?? null)) loadMap(state.map);
    if (checked !== last || !isRead) listPlans();
    if (state.drive && state.drive.begun !== lastDrive?.begun)
      addToLog(`drive of ${state.drive.plan ?? "a plan"}`, "begin");
    return;
  }
  Promise.all([listPlans(), loadMap(state.map)]).then(heard ? null : fit);
  heard = performance.now();
  held = Infinity;
  document.title = `MuSHR ${state.car_name}`;
  say("title", document.title);
  view.set(NOTHING);
  scan = null;
  poses = [];
  subscribe(
    `/${state.car_name}`,
    `/${state.car_name}/mux/ackermann_cmd_mux`,
    state.prefix,
  );
}

function subscribe(car, mux, prefix) {
  const path = (msg) => msg.poses.map((each) => flat(each.pose));
  ros.subscribe(`${car}/car_pose`, onPose, 15);
  ros.subscribe(`${car}/joint_states`, onJoints, 50);
  ros.subscribe(`${car}/odom`, onOdometry, 100);
  ros.subscribe(`${car}/scan`, onScan, 50);
  ros.subscribe(
    `${car}/driven_path`,
    (msg) => view.set({ driven: path(msg) }, false),
    200,
  );
  ros.subscribe(`${car}/predicted_path`, (msg) =>
    view.set({ predicted: path(msg) }),
  );
  ros.subscribe(
    `${car}/car_sim/collision`,
    (msg) => (view.touches = msg.poses.length > 0),
  );
  ros.subscribe(`${mux}/active`, (msg) => {
    owner = msg.data;
    showOwner();
  });
  // Not an input: path_publisher would take the server for a mux, also if the mux is dead.
  ros.subscribe(`${mux}/output`, onOutput, 100);
  ros.subscribe(`${car}/drive_monitor/start`, onStart);
  ros.subscribe(`${car}/drive_monitor/verdict`, onVerdict);
  ros.subscribe(`${prefix}/click_planner/path`, (msg) =>
    view.set({ clicked: path(msg) }),
  );
  ros.subscribe("/rosout_agg", onLog);
}

/** Note when the clock is held [s]; Infinity if it runs. */
function hold(time) {
  held = time;
  const text = `held at ${time.toFixed(2)} s; placing the car takes effect at the next step`;
  say("time-state", time < Infinity ? text : "");
}
function showOwner() {
  say("owner", server.state?.has_mux === false ? "no mux is running" : owner);
}
function onPose(msg) {
  const stamp = seconds(msg.header.stamp);
  const pose = flat(msg.pose);
  if (stamp > held + SAME) hold(Infinity); // any client may have released the clock
  const last = poses.at(-1)?.stamp ?? stamp;
  if (stamp < last) view.driven = []; // it is another car
  poses = [...poses.slice(-60), { stamp, pose }];
  heard = performance.now();
  window.mushr.pose = { x: pose[0], y: pose[1], theta: pose[2], stamp };
  say("pose", poseText(pose) + (view.touches ? ", touches a wall" : ""));
  view.set({ pose }, false);
  if (find("follow").checked) view.set({ x: pose[0], y: pose[1] }, false);
  if (scan) onScan(scan);
}
const onOdometry = ({ twist }) =>
  say("speed", `${twist.twist.linear.x.toFixed(2)} m/s`);
function onJoints({ name, position }) {
  const wheels = ["left", "right"].map(
    (side) => position[name.indexOf(`front_${side}_wheel_steer`)],
  );
  const [left, right] = wheels.map(Math.tan);
  const angle = Math.atan((2 * left * right) / (left + right) || 0); // of a wheel in the middle
  say("steering", `${angle.toFixed(3)} rad`);
  view.set({ wheels }, false);
}
/** Draw a scan from the pose at its stamp, as soon as this pose is known. */
function onScan(msg) {
  const pose = poseAt(poses, seconds(msg.header.stamp));
  scan = pose ? null : msg;
  if (pose) view.set({ scan: points(msg, pose) }, false);
}

function onLog({ level, name, msg }) {
  const { car_name: car, prefix } = server.state ?? {};
  const driver = `${prefix}/path_publisher`;
  const kind = level >= 8 ? "error" : level >= 4 ? "warning" : "";
  if (name === `${prefix}/click_planner` && find("clicks").checked) {
    say("click-state", msg);
    find("click-state").className = kind && "warning";
  }
  if (
    name.startsWith(`/${car}/`) ||
    [driver, `${prefix}/web_view`].includes(name)
  )
    addLine(name, kind, msg);
  if (name === driver && kind === "error") addError(msg);
}
/** Add a line to the log, of a node or of the page itself. */
function addLine(name, kind, msg) {
  const node = name.split("/").at(-1);
  addToLog([node, kind, msg].filter(Boolean).join(": "), kind);
}
function addToLog(text, kind) {
  const log = find("log");
  const isAtEnd = log.scrollTop + log.clientHeight > log.scrollHeight - 10;
  log.append(element("div", text, kind));
  if (log.children.length > 300) log.firstChild.remove();
  if (isAtEnd) log.scrollTop = log.scrollHeight;
}

async function loadMap(number) {
  try {
    const info = number && (await request("map.json"));
    const answer = number && (await fetch(`map.png?${number}`));
    const picture = number && (await createImageBitmap(await answer.blob()));
    view.set({ map: number && { ...info, picture } });
  } catch {
    // The next state of the server has the number of this map, too.
  }
}
/** Call a service of the clock or of click_planner, and show its answer. */
async function call(service, output) {
  const { success, message } = await ros.call(service);
  if (success && output === "time-state")
    hold(service.endsWith("resume") ? Infinity : Number.parseFloat(message));
  else say(output, message || (success ? "done" : "refused"));
  const [, name] = message.match(/^saved .*?([^/]+)\.txt;/) ?? [];
  if (name) listPlans(name);
}
addEventListener("keydown", (event) => {
  const isSpace =
    event.key === " " && !event.target.closest("button, input, select");
  if (event.key !== "Escape" && !isSpace) return;
  event.preventDefault();
  hand.stopHand();
  stopPlan();
});
find("pose-form").onsubmit = (event) => {
  event.preventDefault();
  place(...[0, 1, 2].map((i) => find("pose-form")[i].valueAsNumber));
};
for (const each of ["pause", "resume", "step"]) {
  find(each).onclick = () =>
    call(`/${server.state?.car_name}/car_sim/${each}`, "time-state");
}
for (const each of ["undo", "clear", "save"]) {
  find(each).onclick = () =>
    call(`${server.state?.prefix}/click_planner/${each}`, "click-state");
}
find("tools").onchange = ({ target }) => {
  if (target.type !== "radio") return;
  say("click-state", "");
  find("click-tools").hidden = !find("clicks").checked;
};
find("layers").onchange = () => view.set({});
find("zoom-in").onclick = () => view.zoom(1.4);
find("zoom-out").onclick = () => view.zoom(1 / 1.4);
find("fit").onclick = fit;
window.mushr = {
  view,
  ros,
  pose: null,
};
const onError = (msg) => addLine("web_view", "error", msg);
addEventListener("unhandledrejection", (event) =>
  onError(event.reason.message),
);
ros.start({
  onStatus,
  onError,
  onOpen: () =>
    ros.subscribe("/web_view/state", (msg) => onState(JSON.parse(msg.data))),
});
