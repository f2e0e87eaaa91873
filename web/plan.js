// The plans: their names, the check and the rows of one, and its drive by path_publisher.

import {element, find, poseText, request, say, seconds} from "./page.js";
import {view} from "./view.js";

const TOLERANCE = 1e-4; // of the stamps [s]
const names = find("plan");
let plan = null;
let drive; // that of the server's state; undefined if it is not known
let begin = null; // of the first row [s]; NaN if it is not known
let isStopped = false; // by this page
let errors = []; // of path_publisher

/** Read the names, and show the plan with this name. */
export async function listPlans(name = names.value || "figure_8") {
  try {
    const {plans} = await request("plans");
    const isOld = `${[...names.options].map((each) => each.value)}` === `${plans}`;
    if (!isOld) names.replaceChildren(...plans.map((each) => new Option(each)));
    if (plans.includes(name)) names.value = name;
    plan = await request(`plans/${encodeURIComponent(names.value)}`);
    show(plan);
  } catch (error) {
    find("check").replaceChildren(element("p", `no plan: ${error.message}`, "error"));
  }
}

function show({rows, faults, length, duration, final_pose: end, path}) {
  find("rows").replaceChildren(...rows.map((row) => {
    const tr = element("tr", "");
    const cells = [row.line, row.speed, row.steering_angle, row.duration];
    tr.append(...cells.map((each) => element("td", Number(each.toFixed(4)))));
    return tr;
  }));
  const size = rows.length ? `${rows.length} rows, ${length.toFixed(2)} m, ` +
    `${duration.toFixed(2)} s; ends at ${poseText(end)}` : "cannot be driven";
  const texts = faults.map(({line, column, text}) =>
    [line && `line ${line}`, column && `column ${column}`, text].filter(Boolean).join(": "));
  const verdict = texts.length ? texts.map((text) => element("p", text, "warning")) :
    [element("p", "no faults", "good")];
  find("check").replaceChildren(element("p", size), ...verdict);
  view.set({plan: path});
  updateDrive(drive);
}

export function updateDrive(next) {
  if (next?.running && !drive?.running) {
    // The stamp of the first command is not known of a drive that began before this page.
    [begin, errors, isStopped] = [drive === undefined ? NaN : null, [], false];
    if (plan?.name !== next.plan) listPlans(next.plan);
  }
  drive = next;
  find("stop").disabled = !drive?.running;
  find("drive").disabled = drive === undefined || drive?.running || !plan?.rows.length;
  if (!drive?.running) mark(-1);
  say("drive-state", [result(), ...errors].join("\n"));
}

function result() {
  if (!drive) return drive === null ? "" : "not connected: the drive is not known";
  if (drive.running) return `driving ${drive.plan}`;
  if (drive.exit_status === 0) return `${drive.plan} ended successfully`;
  const how = isStopped ? "was stopped" : "ended: error";
  return `${drive.plan} ${how} (exit status ${drive.exit_status})`;
}

export function addError(text) {
  errors.push(text);
  if (drive) updateDrive(drive);
}

/** A command of the plan: its stamp shows which row is driven. */
export function onCommand({header}) {
  if (!drive?.running || plan?.name !== drive.plan) return;
  const stamp = seconds(header.stamp);
  begin ??= stamp;
  if (stamp - begin > plan.duration + TOLERANCE) begin = stamp; // the next lap
  let end = begin - TOLERANCE;
  mark(plan.rows.findIndex((row) => stamp < (end += row.duration)));
}

function mark(number) {
  const [row, old] = [find("rows").rows[number], find("rows").querySelector("[aria-current]")];
  if (row === old) return;
  old?.removeAttribute("aria-current");
  row?.setAttribute("aria-current", "true"); // then scroll the table, but not the page
  if (row) find("table").scrollTop = row.offsetTop - find("table").clientHeight / 2;
}

const ask = (method, data) =>
  request("drive", method, data).catch((error) => say("drive-state", error.message));

export function stopPlan() {
  isStopped = true;
  if (drive?.running) ask("DELETE");
}

names.onchange = names.onfocus = () => listPlans();
find("stop").onclick = stopPlan;
find("drive").onclick = () => ask("POST", {plan: names.value, spread: find("spread").checked,
  loop: find("loop").checked});
