// Connects the parts of the page with each other and with the topics.

import {Hand} from "./drive.js";
import {element, find, listen, say} from "./page.js";
import {Plans, poseText} from "./plan.js";
import {Pointer} from "./pointer.js";
import {Results} from "./results.js";
import {flat, request, Ros, seconds} from "./ros.js";
import {line, View} from "./view.js";

const LAYERS = ["map", "grid", "driven", "predicted", "scan", "clicked", "spread"];
const LOG_LINES = 300;
const LATE = 1000; // a pose or an answer of the bridge is late after this time [ms]
const LASER = 0.1227; // the laser is so far ahead of the rear axle [m]
const HINTS = {
  pan: "Drag to move the view. Zoom with the wheel or two fingers.",
  place: "Press where the middle of the rear axle shall be, and drag to where the car shall head.",
  clicks: "Set the start pose with Place car, then click the points to drive to.",
};
let state = null;
let mux = "";
let heard = 0; // when the last pose came [ms]
let isHeld = false; // the clock, by this page
let mapProblem = "";
let poses = []; // the last ones: a scan is drawn from the pose of its stamp

const view = new View(find("view"));
const plans = new Plans((plan) => view.set({plan}));
const results = new Results(view);
const pointer = new Pointer(view, {pan: () => follow(false), place, click});
const hand = new Hand(find("pad"), find("knob"), (speed, angle, device) => {
  const header = {frame_id: `${state?.car_name}/base_footprint`};
  ros.publish(`${mux}/input/teleop`, {header, drive: {speed, steering_angle: angle}});
  const values = `${speed.toFixed(2)} m/s, ${angle.toFixed(2)} rad`;
  say("hand-state", device && `driving by ${device}: ${values}`);
});
const ros = new Ros(onStatus);
ros.onOpen = () => {
  view.forget();
  ros.subscribe("/web_view/state", (msg) => onState(JSON.parse(msg.data)));
};
ros.onError = (text) => log({level: 8, name: "/web_view", msg: text});
window.mushr = {view, ros, pose: null, get frames() { return view.frames; }};

function onStatus(isConnected, delay) {
  const text = isConnected ? "connected" : "not connected: trying again every second";
  say("connection", text);
  find("connection").className = isConnected ? "good" : "";
  if (!isConnected) state = null;
  if (!state || delay > LATE) hand.stop();
  if (!state) plans.update(undefined);
  const silence = performance.now() - heard;
  const isLate = !isConnected || (silence > LATE && !isHeld);
  find("readout").classList.toggle("stale", isLate);
  if (isLate !== view.isStale) view.set({isStale: isLate}, false);
  const count = Math.round(silence / 1000);
  const cause = state?.simulated_time ? "is the clock held, or the car not running" : "is the car running";
  say("problem", [
    isConnected && delay > LATE && `the bridge has not answered for ${(delay / 1000).toFixed(1)} s`,
    state?.problem, mapProblem,
    state && isLate && (heard ? `no pose for ${count} s: ${cause}?` : `no pose yet: ${cause}?`),
  ].filter(Boolean).join("; "));
}

/** The server's state. The topics are subscribed to once for each connection. */
function onState(next) {
  const isFirst = !state;
  const oldMap = view.map?.number;
  state = next;
  if (isFirst) subscribe(next);
  if (isFirst) plans.list();
  plans.update(next.drive);
  find("time-section").hidden = !next.holds_clock;
  find("result-section").hidden = !next.results;
  if (isFirst && next.results) results.list();
  if (isFirst || next.map !== oldMap) loadMap(next.map);
}

function subscribe({car_name: car, initial_pose_topic: topic}) {
  mux = `/${car}/mux/ackermann_cmd_mux`;
  heard = 0;
  const advertised = {[topic]: "geometry_msgs/PoseWithCovarianceStamped",
    "/clicked_point": "geometry_msgs/PointStamped",
    [`${mux}/input/teleop`]: "ackermann_msgs/AckermannDriveStamped"};
  Object.entries(advertised).forEach(([name, type]) =>
    ros.send({op: "advertise", topic: name, type}));
  const path = (msg) => msg.poses.map((each) => flat(each.pose));
  ros.subscribe(`/${car}/car_pose`, onPose, 15);
  ros.subscribe(`/${car}/joint_states`, onJoints, 50);
  ros.subscribe(`/${car}/odom`, (msg) =>
    say("speed", `${msg.twist.twist.linear.x.toFixed(2)} m/s`), 100);
  ros.subscribe(`/${car}/scan`, onScan, 50);
  ros.subscribe(`/${car}/driven_path`, onDriven);
  ros.subscribe(`/${car}/predicted_path`, (msg) => view.set({predicted: path(msg)}));
  ros.subscribe("/click_planner/path", (msg) => view.set({clicked: path(msg)}));
  ros.subscribe("/path_publisher/spread_poses", (msg) => view.set({cloud: msg.poses.map(flat)}));
  ros.subscribe("/path_publisher/spread_ellipses", ({markers}) =>
    view.set({ellipses: markers.filter((each) => each.action === 0).map(
      ({pose, scale}) => ({pose: flat(pose), size: scale}))}));
  ros.subscribe(`${mux}/active`, (msg) => say("owner", msg.data));
  ros.subscribe(`${mux}/input/navigation`, (msg) => plans.command(msg));
  ros.subscribe(`/${car}/car_sim/collision`, ({poses: all}) => view.set({touches: all.length > 0}));
  ros.subscribe("/rosout_agg", log);
}

function onPose(msg) {
  const [stamp, now] = [seconds(msg.header.stamp), performance.now()];
  const pose = flat(msg.pose);
  const last = poses.at(-1);
  // Another car: it has not told this page to remove the old lines.
  if (last && (stamp < last.stamp || stamp > last.stamp + 2)) view.driven.clear();
  poses = [...poses.slice(-60), {stamp, pose}];
  heard = now;
  window.mushr.pose = {x: pose[0], y: pose[1], theta: pose[2], stamp};
  say("pose", poseText(pose) + (view.touches ? ", touches a wall" : ""));
  view.set({pose, isStale: false}, false);
  if (find("follow").ariaPressed === "true" && !view.replay) view.move(pose[0], pose[1]);
}

function onJoints({name, position}) {
  const wheels = ["left", "right"].map((side) => position[name.indexOf(`front_${side}_wheel_steer`)]);
  const [left, right] = wheels.map(Math.tan);
  const angle = Math.atan((2 * left * right) / (left + right) || 0); // of a bicycle in the middle
  say("steering", `${angle.toFixed(3)} rad`);
  view.set({wheels}, false);
}

function onScan({header, ranges, angle_min: begin, angle_increment: step}) {
  const stamp = seconds(header.stamp);
  const {pose} = poses.findLast((each) => each.stamp <= stamp + 1e-6) ?? {};
  if (!pose) return;
  const [x, y, theta] = pose;
  const [left, ahead] = [Math.sin(theta) * LASER, Math.cos(theta) * LASER];
  const scan = [];
  ranges.forEach((range, i) => {
    const angle = theta + begin + i * step;
    if (range !== null) scan.push([x + ahead + range * Math.cos(angle), y + left + range * Math.sin(angle)]);
  });
  view.set({scan}, false);
}

/** Each message replaces one line, or removes all of them. */
function onDriven({action, id, points}) {
  if (action === 3) view.driven.clear();
  else view.driven.set(id, line(points.map(({x, y}) => [x, y])));
  view.set({}, false);
}

function log({level, name, msg}) {
  const isOfPlan = name === "/path_publisher";
  if (name === "/click_planner") say("click-state", msg);
  if (!isOfPlan && !name.startsWith(`/${state?.car_name}/`) && name !== "/web_view") return;
  const [kind, word] = level >= 8 ? ["error", "error: "] : level === 4 ? ["warning", "warning: "] : [""];
  const box = find("log");
  const isAtEnd = box.scrollTop + box.clientHeight > box.scrollHeight - 20;
  box.append(element("div", `${name.slice(1)}: ${word ?? ""}${msg}`, kind));
  if (box.children.length > LOG_LINES) box.firstChild.remove();
  if (isAtEnd) box.scrollTop = box.scrollHeight;
  if (isOfPlan) plans.log(level, msg);
}

async function loadMap(number) {
  try {
    mapProblem = "";
    if (number === null) return view.set({map: null});
    const info = await request("map.json");
    const answer = await fetch(`map.png?${info.number}`);
    if (!answer.ok) throw new Error(`status ${answer.status}`);
    const picture = await createImageBitmap(await answer.blob());
    const isFirst = !view.map;
    view.setMap(info, picture);
    if (isFirst) fit();
  } catch (error) {
    mapProblem = `the map cannot be read: ${error.message}`;
  }
}

function fit() {
  follow(false);
  view.fit([...view.plan, ...view.predicted, ...view.clicked, ...(view.pose ? [view.pose] : [])]);
}

function follow(isOn) {
  find("follow").ariaPressed = String(isOn);
  if (isOn && view.pose) view.move(view.pose[0], view.pose[1]);
}

function place(x, y, theta) {
  const heading = theta ?? view.pose?.[2] ?? 0;
  const orientation = {x: 0, y: 0, z: Math.sin(heading / 2), w: Math.cos(heading / 2)};
  const pose = {position: {x, y, z: 0}, orientation};
  ros.publish(state?.initial_pose_topic, {header: {frame_id: "map"}, pose: {pose}});
  [["x", x], ["y", y], ["theta", heading]].forEach(([name, value]) =>
    (find(`place-${name}`).value = value.toFixed(3)));
}

function click(x, y) {
  ros.publish("/clicked_point", {header: {frame_id: "map"}, point: {x, y, z: 0}});
}

/** Call a service and show its answer. */
async function trigger(service, place) {
  const answer = await ros.call(service).catch((error) => ({success: false, message: error.message}));
  say(place, answer.message || (answer.success ? "done" : "refused, without a reason"));
  return answer.success;
}

async function time(service) {
  const isDone = await trigger(`/${state?.car_name}/car_sim/${service}`, "time-state");
  if (isDone) isHeld = service !== "resume";
}

async function save() {
  const isDone = await trigger("/click_planner/save", "click-state");
  const [, name] = find("click-state").textContent.match(/([^/]+)\.txt;/) ?? [];
  if (isDone) plans.list(name);
}

function choose(mode) {
  pointer.mode = mode;
  Object.keys(HINTS).forEach((each) => (find(each).ariaPressed = String(each === mode)));
  say("hint", HINTS[mode]);
  find("view").className = mode === "pan" ? "" : "aim";
}

function onKey(event) {
  const isFree = !event.target.closest("button, input, select, [tabindex='0'].scroll");
  if (event.key !== "Escape" && !(event.key === " " && isFree)) return;
  event.preventDefault();
  hand.stop();
  if (state?.drive?.running) plans.stop();
}

listen(window, "keydown", onKey);
Object.keys(HINTS).forEach((mode) => listen(find(mode), "click", () => choose(mode)));
choose("pan");
listen(find("zoom-in"), "click", () => view.zoom(1.4));
listen(find("zoom-out"), "click", () => view.zoom(1 / 1.4));
listen(find("fit"), "click", fit);
listen(find("follow"), "click", () => follow(find("follow").ariaPressed !== "true"));
["pause", "resume", "step"].forEach((each) => listen(find(each), "click", () => time(each)));
["undo", "clear"].forEach((each) =>
  listen(find(each), "click", () => trigger(`/click_planner/${each}`, "click-state")));
listen(find("save"), "click", save);
listen(find("pose-form"), "submit", (event) => {
  event.preventDefault();
  place(...["x", "y", "theta"].map((name) => Number(find(`place-${name}`).value)));
});
LAYERS.forEach((name) => listen(find(`show-${name}`), "change", () =>
  view.set({hidden: {...view.hidden, [name]: !find(`show-${name}`).checked}})));
