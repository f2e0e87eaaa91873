// The plans: their names, the check and the rows of one, and its drive by path_publisher.

import {element, find, poseText, request, say, seconds} from "./page.js";
import {view} from "./view.js";

const TOLERANCE = 1e-4; // of the stamps [s]
let plan = null;
let drive; // that of the server's state; undefined if it is not known
let begin = null; // of the first row [s]; NaN if it is not known
let isStopped = false; // by this page
let errors = []; // of path_publisher

/** Read the names, and show the plan with this name. */
export async function listPlans(name = find("plan").value || "figure_8") {
  try {
    const {plans} = await request("plans");
    const old = [...find("plan").options].map((each) => each.value);
    if (`${old}` !== `${plans}`) find("plan").replaceChildren(...plans.map((each) => new Option(each)));
    if (plans.includes(name)) find("plan").value = name;
    plan = await request(`plans/${encodeURIComponent(find("plan").value)}`);
    showPlan();
  } catch (error) {
    find("check").replaceChildren(element("p", `no plan: ${error.message}`, "error"));
  }
}

function showPlan() {
  find("rows").replaceChildren(...plan.rows.map((row) => {
    const tr = element("tr", "");
    const cells = [row.line, row.speed, row.steering_angle, row.duration];
    tr.append(...cells.map((each) => element("td", Number(each.toFixed(4)))));
    return tr;
  }));
  const size = plan.rows.length ? `${plan.rows.length} rows, ${plan.length.toFixed(2)} m, ` +
    `${plan.duration.toFixed(2)} s; ends at ${poseText(plan.final_pose)}` : "cannot be driven";
  const faults = plan.faults.map(({line, column, text}) => element("p",
    [line && `line ${line}`, column && `column ${column}`, text].filter(Boolean).join(": "), "warning"));
  const verdict = faults.length ? faults : [element("p", "no faults", "good")];
  find("check").replaceChildren(element("p", size), ...verdict);
  view.set({plan: plan.path});
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
  const status = `(exit status ${drive.exit_status})`;
  return `${drive.plan} ${isStopped ? "was stopped" : "ended: error"} ${status}`;
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
  const row = find("rows").rows[number];
  const old = find("rows").querySelector("[aria-current]");
  if (old === (row ?? null)) return;
  old?.removeAttribute("aria-current");
  row?.setAttribute("aria-current", "true");
  const box = find("rows").closest("#table"); // scrollIntoView would also scroll the page
  if (row) box.scrollTop = row.offsetTop - box.clientHeight / 2;
}

const ask = (method, data) =>
  request("drive", method, data).catch((error) => say("drive-state", error.message));

export function stopPlan() {
  isStopped = true;
  if (drive?.running) ask("DELETE");
}

find("plan").onchange = find("plan").onfocus = () => listPlans();
find("stop").onclick = stopPlan;
find("drive").onclick = () => ask("POST", {plan: find("plan").value,
  spread: find("spread").checked, loop: find("loop").checked});
