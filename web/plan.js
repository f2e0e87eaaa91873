// The plans: their names, the check and the rows of one, and its drive by path_publisher.

import {element, find, listen, say} from "./page.js";
import {request, seconds} from "./ros.js";

const TOLERANCE = 1e-4; // of the stamps [s]

export const poseText = ([x, y, theta]) =>
  `${x.toFixed(3)} m, ${y.toFixed(3)} m, ${theta.toFixed(3)} rad`;

export class Plans {
  /** onShow(path): another plan is shown. */
  constructor(onShow) {
    Object.assign(this, {onShow, plan: null, drive: null, errors: [], begin: null, ends: []});
    listen(find("plan"), "change", () => this.show());
    listen(find("plan"), "focus", () => this.list());
    listen(find("drive"), "click", () => this.start());
    listen(find("stop"), "click", () => this.stop());
  }

  /** Read the names, and select one. */
  async list(name = find("plan").value || "figure_8") {
    try {
      const {plans} = await request("plans");
      const old = [...find("plan").options].map((each) => each.value);
      const options = plans.map((each) => new Option(each));
      if (String(old) !== String(plans)) find("plan").replaceChildren(...options);
      if (plans.includes(name)) find("plan").value = name;
      if (find("plan").value !== this.plan?.name) await this.show();
    } catch (error) {
      this.report([["error", `The plans cannot be read: ${error.message}`]]);
    }
  }

  async show() {
    const name = find("plan").value;
    const plan = await request(`plans/${encodeURIComponent(name)}`);
    if (name !== find("plan").value) return; // another one was selected in the meantime
    this.plan = plan;
    let end = 0;
    this.ends = plan.rows.map((row) => (end += row.duration));
    find("rows").replaceChildren(...plan.rows.map((row) => {
      const tr = element("tr", "");
      const cells = [row.line, row.speed, row.steering_angle, row.duration];
      tr.append(...cells.map((each) => element("td", Number(each.toFixed(4)))));
      return tr;
    }));
    const size = plan.rows.length && `${plan.rows.length} rows, ${plan.length.toFixed(2)} m, ` +
      `${plan.duration.toFixed(2)} s; ends at ${poseText(plan.final_pose)}`;
    const faults = plan.faults.map(({line, column, text}) => ["warning",
      [line && `line ${line}`, column && `column ${column}`].filter(Boolean).join(", ") + `: ${text}`]);
    this.report([["", size || "This plan cannot be driven."], ...faults,
      ...(faults.length ? [] : [["good", "No faults."]])]);
    this.onShow(plan.path);
    this.update(this.drive);
  }

  report(lines) {
    find("check").replaceChildren(...lines.map(([name, text]) => element("p", text, name)));
  }

  async start() {
    const options = {spread: find("spread").checked, loop: find("loop").checked};
    await this.ask("POST", {plan: find("plan").value, ...options});
  }

  async stop() {
    this.isStopped = true;
    await this.ask("DELETE");
  }

  async ask(method, body) {
    await request("drive", method, body).catch((error) => say("drive-state", error.message));
  }

  /** `drive` is that of the server's state; undefined if it is unknown. */
  update(drive) {
    const isNew = drive?.running && !(this.drive?.running && this.drive.plan === drive.plan);
    if (isNew) {
      // Of a drive that was running before this page, the first command is not known.
      Object.assign(this, {errors: [], isStopped: false, isWhole: this.drive !== undefined});
      Object.assign(this, {begin: null});
      this.list(drive.plan);
    }
    this.drive = drive;
    find("stop").disabled = !drive?.running;
    find("drive").disabled = drive === undefined || drive?.running || !this.plan?.rows.length;
    if (!drive?.running) this.mark(-1);
    say("drive-state", [this.result(), ...this.errors].join("\n"));
  }

  result() {
    if (!this.drive) return this.drive === null ? "" : "not connected: the drive is unknown";
    const {plan, running, exit_status: status} = this.drive;
    if (running) return `driving ${plan}`;
    if (status === 0) return `${plan} ended successfully`;
    return `${plan} ${this.isStopped ? "was stopped" : "ended with an error"} (exit status ${status})`;
  }

  /** A message of path_publisher's log. */
  log(level, text) {
    if (level < 8 || !this.drive) return;
    this.errors.push(text);
    this.update(this.drive);
  }

  /** A command of the plan: its stamp shows which row is driven. */
  command(msg) {
    const {drive, plan, ends} = this;
    if (!drive?.running || !this.isWhole || plan?.name !== drive.plan) return;
    const stamp = seconds(msg.header.stamp);
    this.begin ??= stamp;
    if (stamp - this.begin > plan.duration + TOLERANCE) this.begin = stamp; // the next lap
    this.mark(ends.findIndex((end) => stamp - this.begin < end - TOLERANCE));
  }

  mark(number) {
    const rows = find("rows");
    const old = rows.querySelector("[aria-current]");
    const row = rows.rows[number];
    if (old === row) return;
    old?.removeAttribute("aria-current");
    row?.setAttribute("aria-current", "true");
    const box = rows.closest(".scroll"); // not scrollIntoView, which also scrolls the page
    if (row) box.scrollTop = row.offsetTop - box.clientHeight / 2;
  }
}
