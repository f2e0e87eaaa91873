// Drives in the files of grade.py or compare_drive.py: played back beside the predicted path.

import { find, poseText, request, say } from "./page.js";
import { fit } from "./plan.js";
import { NOTHING, view } from "./view.js";

const slider = find("time");
const button = find("play");
const GRADES = { true: ": passed", false: ": failed" };
let result = {};

/** List the drives, and read the shown one again: it may have been graded again. */
export async function listResults() {
  let results = [];
  let problem = "the folder contains no drive";
  try {
    ({ results } = await request("results"));
  } catch (error) {
    problem = error.message;
  }
  const options = results.map(
    ({ name, passed }) => new Option(name + (GRADES[passed] ?? ""), name),
  );
  find("result").replaceChildren(
    new Option("none: show the live car", ""),
    ...options,
  );
  find("result").value = result.name ?? "";
  const { value: name } = find("result"); // empty if the drive is not listed any more
  const found = await read(name);
  const isNew = JSON.stringify(found) !== JSON.stringify(result);
  if (isNew && find("result").value === name) {
    const gone = name ? "" : `${result.name} is no longer in the folder`;
    show(found);
    if (gone) say("verdict", gone);
  }
  if (!results.length) say("verdict", problem);
}
const read = async (name) =>
  name ? await request(`results/${encodeURI(name)}`) : {};
/** Show a drive from its beginning, or without a name, the live car. */
function show(found) {
  result = found;
  const { name = "" } = result;
  find("result").value = name; // the list may have been filled since this drive was chosen
  say("verdict", result.verdict ?? "");
  view.set({ replay: null });
  button.checked = false;
  find("player").hidden = !name;
  find("live").hidden = name !== "";
  say("recording", "");
  if (!name) return fit();
  Object.assign(slider, {
    max: Math.ceil(100 * result.times.at(-1)) / 100,
    value: 0,
  });
  view.fit([...result.driven, ...result.predicted]);
  showPose();
}
/** Show the drive at the time of the slider. */
function showPose() {
  const { times, driven, predicted } = result;
  const time = slider.valueAsNumber;
  const count = Math.max(
    1,
    times.findLastIndex((each) => each <= time + 1e-9) + 1,
  );
  const pose = driven[count - 1];
  say(
    "recording",
    `Recording of ${result.name}, not the live car: ` +
      `${time.toFixed(2)} s of ${times.at(-1).toFixed(2)} s, ${poseText(pose)}`,
  );
  view.set(
    {
      replay: { ...NOTHING, driven: driven.slice(0, count), predicted, pose },
    },
    !view.replay,
  );
}
/** Play on from the slider's time, until the end or until the box is not checked. */
const play = (last) =>
  requestAnimationFrame((now) => {
    if (!button.checked) return;
    slider.value = slider.valueAsNumber + Math.max(0, now - last) / 1000;
    showPose();
    if (slider.value === slider.max) button.checked = false;
    play(now);
  });
find("result").onchange = async () => show(await read(find("result").value));
find("result").onfocus = listResults;
slider.oninput = showPose;
button.onchange = () => {
  if (slider.value === slider.max) slider.value = 0;
  play(performance.now());
};
