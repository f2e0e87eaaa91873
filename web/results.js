// Drives that the grading tool has recorded: played back beside the predicted path.

import {find, listen, say} from "./page.js";
import {poseText} from "./plan.js";
import {request} from "./ros.js";
import {line} from "./view.js";

export class Results {
  constructor(view) {
    Object.assign(this, {view, result: null, last: 0});
    listen(find("result"), "change", () => this.open(find("result").value));
    listen(find("time"), "input", () => this.show());
    listen(find("play"), "click", () => this.play(find("play").textContent === "Play"));
  }

  async list() {
    const {results} = await request("results");
    const options = results.map(({name, passed}) =>
      new Option(`${name}: ${passed ? "passed" : "failed"}`, name));
    const {value} = find("result");
    find("result").replaceChildren(new Option("none: show the live car", ""), ...options);
    find("result").value = results.some(({name}) => name === value) ? value : "";
  }

  async open(name) {
    this.play(false);
    const path = `results/${name.split("/").map(encodeURIComponent).join("/")}`;
    this.result = name ? await request(path) : null;
    find("player").hidden = !this.result?.times.length;
    say("verdict", this.result?.verdict ?? "");
    this.view.set({replay: null});
    if (find("player").hidden) return;
    find("time").max = this.result.times.at(-1);
    find("time").value = 0;
    this.view.fit([...this.result.driven, ...this.result.predicted]);
    this.show();
  }

  /** Show the drive at the time of the slider. */
  show() {
    const {times, driven, predicted} = this.result;
    const time = Number(find("time").value);
    const count = Math.max(1, times.findLastIndex((each) => each <= time + 1e-9) + 1);
    const pose = driven[count - 1];
    say("time-text", `${time.toFixed(2)} s of ${times.at(-1).toFixed(2)} s: ${poseText(pose)}`);
    this.view.set({replay: {driven: [line(driven.slice(0, count))], predicted, pose}});
  }

  play(isPlaying) {
    say("play", isPlaying ? "Halt" : "Play");
    if (isPlaying && Number(find("time").value) >= Number(find("time").max)) find("time").value = 0;
    this.last = performance.now();
    if (isPlaying) requestAnimationFrame((now) => this.advance(now));
  }

  advance(now) {
    if (find("play").textContent !== "Halt") return;
    find("time").value = Number(find("time").value) + Math.max(0, now - this.last) / 1000;
    this.last = now;
    this.show();
    const isAtEnd = Number(find("time").value) >= Number(find("time").max);
    if (isAtEnd) this.play(false);
    else requestAnimationFrame((next) => this.advance(next));
  }
}
