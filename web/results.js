// Drives that the grading tool has recorded: played back beside the predicted path.

import {find, poseText, request, say} from "./page.js";
import {NOTHING, view} from "./view.js";

const [slider, button] = [find("time"), find("play")];
let result = {times: []};

export async function listResults() {
  const {results} = await request("results");
  const options = results.map(({name, passed}) =>
    new Option(`${name}: ${passed ? "passed" : "failed"}`, name));
  find("result").replaceChildren(new Option("none: show the live car", ""), ...options);
  find("result").value = result.name ?? "";
}

async function open(name) {
  result = name ? await request(`results/${encodeURI(name)}`) : {times: []};
  say("verdict", result.verdict ?? "");
  say("play", "Play");
  find("player").hidden = !result.times.length;
  view.set({replay: null});
  if (find("player").hidden) return;
  Object.assign(slider, {max: Math.ceil(100 * result.times.at(-1)) / 100, value: 0});
  view.fit([...result.driven, ...result.predicted]);
  show();
}

/** Show the drive at the time of the slider. */
function show() {
  const {times, driven, predicted} = result;
  const time = slider.valueAsNumber;
  const count = Math.max(1, times.findLastIndex((each) => each <= time + 1e-9) + 1);
  const pose = driven[count - 1];
  say("time-text", `${time.toFixed(2)} s of ${times.at(-1).toFixed(2)} s: ${poseText(pose)}`);
  view.set({replay: {...NOTHING, driven: [driven.slice(0, count)], predicted, pose}}, !view.replay);
}

/** Play on from the slider's time, until the end or a press of the button. */
const play = (last) => requestAnimationFrame((now) => {
  if (button.textContent === "Play") return;
  slider.value = slider.valueAsNumber + Math.max(0, now - last) / 1000;
  show();
  if (slider.value === slider.max) say("play", "Play");
  play(now);
});

find("result").onchange = () => open(find("result").value);
slider.oninput = show;
button.onclick = () => {
  if (slider.value === slider.max) slider.value = 0;
  say("play", button.textContent === "Play" ? "Halt" : "Play");
  play(performance.now());
};
