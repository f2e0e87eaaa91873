// Drives that the grading tool has recorded: played back beside the predicted path.

import {find, poseText, request, say} from "./page.js";
import {line, NOTHING, view} from "./view.js";

let result = null;
let isPlaying = false;
const isAtEnd = () => find("time").value === find("time").max;

export async function listResults() {
  const {results} = await request("results");
  const options = results.map(({name, passed}) =>
    new Option(`${name}: ${passed ? "passed" : "failed"}`, name));
  find("result").replaceChildren(new Option("none: show the live car", ""), ...options);
  if (result) find("result").value = result.name;
}

async function open(name) {
  play(false);
  result = name ? await request(`results/${encodeURI(name)}`) : null;
  say("verdict", result?.verdict ?? "");
  find("player").hidden = !result?.times.length;
  view.set({replay: null});
  if (find("player").hidden) return;
  find("time").max = Math.ceil(100 * result.times.at(-1)) / 100;
  find("time").value = 0;
  view.fit([...result.driven, ...result.predicted]);
  show();
}

/** Show the drive at the time of the slider. */
function show() {
  const {times, driven, predicted} = result;
  const time = find("time").valueAsNumber;
  const count = Math.max(1, times.findLastIndex((each) => each <= time + 1e-9) + 1);
  const pose = driven[count - 1];
  say("time-text", `${time.toFixed(2)} s of ${times.at(-1).toFixed(2)} s: ${poseText(pose)}`);
  const replay = {...NOTHING, driven: [line(driven.slice(0, count))], predicted, pose};
  view.set({replay}, !view.replay);
}

function play(isOn) {
  if (isOn && isAtEnd()) find("time").value = 0;
  isPlaying = isOn;
  say("play", isOn ? "Halt" : "Play");
  if (isOn) advance(performance.now());
}

function advance(last) {
  requestAnimationFrame((now) => {
    if (!isPlaying) return;
    find("time").value = find("time").valueAsNumber + Math.max(0, now - last) / 1000;
    show();
    if (isAtEnd()) play(false);
    else advance(now);
  });
}

find("result").onchange = () => open(find("result").value);
find("time").oninput = show;
find("play").onclick = () => play(!isPlaying);
