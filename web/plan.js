// The plans: their names, the check and the rows of one, and its drive by path_publisher.

import { element, find, poseText, request, say, seconds } from "./page.js";
import { view } from "./view.js";

const TOLERANCE = 1e-4; // of the stamps [s]
const names = find("plan");
const table = find("rows");
const stop = find("stop");
let plan = { rows: [] };
let drive; // that of the server's state; undefined if it is not known
let begin; // when the first row began [s]; null before it, NaN if it is not known
let isStopped = false; // by this page
let errors = []; // of path_publisher

/** Read the names, and show the plan with this name. */
export async function listPlans(name = names.value || "figure_8") {
  const { plans } = await request("plans");
  const isOld =
    `${[...names.options].map((each) => each.value)}` === `${plans}`;
  if (!isOld) names.replaceChildren(...plans.map((each) => new Option(each)));
  if (plans.includes(name)) names.value = name;
  if (names.value !== plan.name) say("check", "reading the plan");
  const found = await request(`plans/${encodeURIComponent(names.value)}`);
  if (found.name === names.value) show((plan = found));
}

function show({ rows, faults, length, duration, final_pose: end, path }) {
  const cells = (row) =>
    [row.line, row.speed, row.steering_angle, row.duration]
      .map((each) => `<td>${Number(each.toFixed(4))}</td>`)
      .join("");
  table.innerHTML = rows.map((row) => `<tr>${cells(row)}</tr>`).join("");
  const size = rows.length
    ? `${rows.length} rows, ${length.toFixed(2)} m, ` +
      `${duration.toFixed(2)} s; ends at ${poseText(end)}`
    : "cannot be driven";
  const texts = faults.map(({ line, column, text }) =>
    [line && `line ${line}`, column && `column ${column}`, text]
      .filter(Boolean)
      .join(": "),
  );
  const lines = texts.length
    ? texts.map((text) => [text, "warning"])
    : [["no faults", "good"]];
  find("check").replaceChildren(
    ...[[size], ...lines].map((each) => element("p", ...each)),
  );
  view.set({ plan: path });
  updateDrive(drive);
}

function mayRun() {
  return drive === undefined || drive?.running;
}
export function updateDrive(next) {
  const isNew = next?.running && !drive?.running;
  // The stamp of the first command is not known of a drive that began before this page.
  const isKnown = drive !== undefined;
  if (isNew) {
    begin = isKnown ? null : NaN;
    errors = [];
    isStopped &&= !isKnown;
  }
  if (isNew && plan.name !== next.plan) listPlans(next.plan);
  drive = next;
  stop.disabled = !mayRun();
  find("drive").disabled = mayRun() || !plan.rows.length;
  if (!drive?.running) mark(-1);
  say("drive-state", [result(), ...errors].join("\n"));
}
function result() {
  if (!drive)
    return drive === null ? "" : "not connected: the drive is not known";
  if (drive.running) return `driving ${drive.plan}`;
  if (drive.exit_status === 0) return `${drive.plan} ended successfully`;
  const how = isStopped ? "stopped" : "error";
  return `${drive.plan} ended: ${how}, exit status ${drive.exit_status}`;
}

export function addError(text) {
  errors.push(text);
  if (drive) updateDrive(drive);
}
/** A command of the plan: its stamp shows which row is driven. */
export function onCommand({ header }) {
  if (!drive?.running || plan.name !== drive.plan) return;
  const stamp = seconds(header.stamp);
  begin ??= stamp;
  if (stamp - begin > plan.duration + TOLERANCE) begin = stamp; // the next lap
  let end = begin - TOLERANCE;
  mark(plan.rows.findIndex((row) => stamp < (end += row.duration)));
}
function mark(number) {
  const row = table.rows[number];
  const old = table.querySelector("[aria-current]");
  if (row === old) return;
  old?.removeAttribute("aria-current");
  if (!row) return;
  row.setAttribute("aria-current", "true");
  // Scroll the table, but not the page.
  find("table").scrollTop = row.offsetTop - find("table").clientHeight / 2;
}
const ask = (data, method) =>
  request("drive", data, method).catch((error) =>
    say("drive-state", error.message),
  );
export function stopPlan() {
  isStopped = true;
  // A request may arrive even without the connection, so a drive that is not known is stopped, too.
  if (mayRun()) ask(undefined, "DELETE");
}
stop.onclick = stopPlan;
names.onchange = names.onfocus = () => listPlans();
find("drive").onclick = () =>
  ask({
    plan: names.value,
    spread: find("spread").checked,
    loop: find("loop").checked,
  });
