// The plans: their names, the check and the rows of one, and its drive by path_publisher.

import {
  counted,
  element,
  find,
  fixed,
  poseText,
  request,
  say,
  seconds,
  server,
} from "./page.js";
import { view } from "./view.js";

const TOLERANCE = 1e-4; // of the stamps [s]
const names = find("plan");
const table = find("rows");
const buttons = { drive: find("drive"), stop: find("stop") };
let plan = { rows: [] };
let ends = []; // of the rows in the table, from the start of the drive [s]
let drive; // that of the server's state; undefined if it is not known
let begun; // when the latest drive began, which tells drives apart; null if there was none
let start = NaN; // when the first row of the running drive or lap began [s]; before that, NaN
let errors = []; // of path_publisher
let verdict = ""; // of drive_monitor, on the latest drive that has ended
let refusal = ""; // the server's answer to the last press of a button in this drive
let beside = ""; // the version of the chosen plan when the latest drive ended in this page
export let isRead = true; // whether the last reading of the plan has succeeded
let asked = 0; // the number of the newest request for a plan
let missing = ""; // the plan to show as soon as the server lists it

/** Show the names of the server's state; read the plan with this name, and show it. */
export async function listPlans(
  name = missing || names.value || (server.state.drive?.plan ?? "figure_8"),
) {
  const plans = Object.keys(server.state.plans);
  const isOld =
    `${[...names.options].map((each) => each.value)}` === `${plans}`;
  if (!isOld) names.replaceChildren(...plans.map((each) => new Option(each)));
  missing = plans.includes(name) ? "" : name;
  // At first, any plan; later never another one than the user has chosen.
  if (!missing || plan.name !== undefined)
    names.value = missing ? plan.name : name;
  if (names.value !== (plan.name ?? "")) {
    const text = names.value ? "reading the plan" : `there is no plan ${name}`;
    plan = { name: names.value, rows: [], faults: [], path: [] };
    show(plan);
    say("check", text);
  }
  if (!names.value) return;
  const path = `plans/${encodeURIComponent(names.value)}`;
  const number = (asked += 1);
  const found = await request(path).catch((error) => error);
  if (number !== asked) return; // answers may come in another order
  isRead = !(found instanceof Error);
  if (!isRead) say("check", found.message);
  else if (found.name === names.value) show((plan = found));
}
/** What a plan does: until a wall, if it hits one. The fault contains the time of the wall. */
function size({ row_count: count, length, duration, wall, ...found }) {
  if (!count) return "cannot be driven";
  const pose = poseText(found.final_pose);
  const note = found.ignores_noise ? ", without random errors" : "";
  const all = `${counted(count, "row")}, ${duration.toFixed(2)} s`;
  const driven = `${length.toFixed(2)} m`;
  return wall === null
    ? `${all}, ${driven}; ends at ${pose}${note}`
    : `${all}; hits a wall after ${driven}, at ${pose}${note}`;
}
/** The server sends the first rows and faults only: the others would take minutes and gigabytes. */
const others = (all, shown, noun) =>
  all > shown.length
    ? [`... and ${counted(all - shown.length, `more ${noun}`)}`]
    : [];
const startText = (pose) =>
  ["x", "y", "theta"].map((name, i) => `${name} ${fixed(pose[i])}`).join(", ");
function show({
  start: pose,
  start_line,
  rows,
  row_count,
  faults,
  fault_count,
  path,
}) {
  const cells = (row) =>
    [row.line, row.speed, row.steering_angle, row.duration]
      .map((each) => `<td>${Number(each.toFixed(4))}</td>`)
      .join("");
  const more = others(row_count, rows, "row");
  const begin = pose
    ? [`<td>${start_line}</td><td colspan="3">start ${startText(pose)}</td>`]
    : [];
  table.innerHTML = [
    ...begin,
    ...rows.map(cells),
    ...more.map((text) => `<td colspan="4">${text}</td>`),
  ]
    .map((each) => `<tr>${each}</tr>`)
    .join("");
  let end = 0;
  ends = rows.map((row) => (end += row.duration));
  const texts = faults.map(({ line, column, text }) =>
    [line && `line ${line}`, column && `column ${column}`, text]
      .filter(Boolean)
      .join(": "),
  );
  texts.push(...others(fault_count, faults, "fault"));
  const lines = texts.length
    ? texts.map((text) => [text, row_count ? "warning" : "error"])
    : [["no faults", "good"]];
  if (server.state?.has_car === false)
    lines.push(["no simulated car is running: its limits are not checked"]);
  find("check").replaceChildren(
    ...[[size(plan)], ...lines].map((each) => element("p", ...each)),
  );
  view.set({ plan: path });
  updateDrive(drive);
}

/** Show the whole plan, and the car. */
export function fit() {
  find("follow").checked = false;
  const all = [...plan.path, ...view.predicted, ...view.clicked];
  if (view.pose) all.push(view.pose);
  view.fit(
    all.length
      ? all
      : [
          [-5, -5],
          [5, 5],
        ],
  );
}

function mayRun() {
  return drive === undefined || drive?.running;
}
export function updateDrive(next) {
  const isNew = next !== undefined && (next?.begun ?? null) !== begun;
  // A plan that another page or a terminal drives.
  const isOther = begun !== undefined && next?.plan && next.plan !== plan.name;
  if (isNew) {
    errors = [];
    verdict = "";
    refusal = "";
    beside = "";
    begun = next?.begun ?? null;
  }
  if (drive?.running && !next?.running) {
    start = NaN;
    beside = version();
  }
  drive = next;
  buttons.stop.disabled = !mayRun();
  buttons.drive.disabled = mayRun() || !plan.rows.length;
  // A disabled button would lose the focus to the beginning of the page.
  if (document.activeElement.disabled)
    (Object.values(buttons).find((each) => !each.disabled) ?? names).focus();
  if (!drive?.running) mark(-1);
  say("drive-state", [result(), refusal].filter(Boolean).join("\n"));
  if (isNew && isOther) listPlans(drive.plan).then(fit);
}
/** Whether the latest drive is one of the chosen plan, which has not been changed since. */
const isOfPlan = () =>
  drive?.plan === plan.name && drive.written === server.state.plans[plan.name];
const version = () => `${plan.name} ${server.state?.plans[plan.name]}`;
/** The state of the drive, and the result of one of the chosen plan, or that has just ended. */
function result() {
  if (drive === undefined) return "not connected: the drive is not known";
  if (!drive || !(drive.running || isOfPlan() || beside === version()))
    return "";
  const { running, stopped } = drive;
  const isChanged = drive.plan === plan.name && !isOfPlan();
  const name = isChanged
    ? `another version of ${drive.plan}`
    : (drive.plan ?? "a plan that is not in the list");
  const action = stopped ? "stopping" : start >= 0 ? "driving" : "starting";
  const end = stopped ? "was stopped" : "has ended";
  const state = running ? `${action} ${name}` : `the drive of ${name} ${end}`;
  return [state, ...errors, running ? "" : verdict].filter(Boolean).join("\n");
}

export function addError(text) {
  if (!drive?.running) return; // it belongs to a drive that the server does not know yet
  errors.push(text);
  updateDrive(drive);
}
/** drive_monitor publishes when the first row begins, in each lap; 0 if no plan is driven. */
export function onStart({ data }) {
  start = seconds(data) || NaN;
  updateDrive(drive);
}
/** How a drive has ended, or an empty text while one is running. */
export function onVerdict({ data }) {
  verdict = data;
  updateDrive(drive);
}
/** A command for the car, of any input of the mux: its stamp shows which row is driven. */
export function onOutput({ header }) {
  if (!drive?.running || !isOfPlan()) return;
  const time = seconds(header.stamp) - start + TOLERANCE;
  // The line below the rows stands for the others.
  mark(time >= 0 ? ends.filter((end) => end <= time).length : -1);
}
function mark(number) {
  const row = number < 0 ? undefined : table.rows[number + 1]; // the first one is the start pose
  const old = table.querySelector("[aria-current]");
  if (row === old) return;
  old?.removeAttribute("aria-current");
  if (!row) return;
  row.setAttribute("aria-current", "true");
  // Scroll the table, but not the page.
  find("table").scrollTop = row.offsetTop - find("table").clientHeight / 2;
}
async function ask(data, method) {
  refusal = await request("drive", data, method).then(
    () => "",
    (error) => error.message,
  );
  updateDrive(drive);
}
export function stopPlan() {
  // A request may arrive even without the connection, so a drive that is not known is stopped, too.
  if (mayRun()) ask(undefined, "DELETE");
}
buttons.stop.onclick = stopPlan;
buttons.stop.onpointerdown = stopPlan; // a finger that rests on a button makes no click
names.onfocus = () => server.state && listPlans(names.value);
names.onchange = async () => {
  // What an earlier drive has published does not belong to this plan.
  if (!drive?.running) view.set({ predicted: [] });
  await listPlans(names.value);
  fit();
};
buttons.drive.onclick = () =>
  ask({
    plan: names.value,
    loop: find("loop").checked,
  });
