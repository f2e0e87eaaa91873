// What all parts of the page use.

export const server = { state: null }; // the server's state; null without a connection
export const find = (id) => document.getElementById(id);
export const element = (kind, textContent, className = "") =>
  Object.assign(document.createElement(kind), { textContent, className });
/** Change a text only if it differs: screen readers read each change. */
export function say(id, text) {
  if (find(id).textContent !== text) find(id).textContent = text;
}
export const fixed = (value) => (Number(value.toFixed(3)) + 0).toFixed(3); // no -0.000
/** A pose as text; the heading is in (-pi, pi]. */
export const poseText = ([x, y, theta]) => {
  const turns = Math.ceil(theta / (2 * Math.PI) - 0.5);
  const heading = theta - 2 * Math.PI * turns;
  return `${fixed(x)} m, ${fixed(y)} m, ${fixed(heading)} rad`;
};
/** A number with its noun, such as 2 rows. */
export const counted = (count, noun) =>
  `${count} ${noun}${count === 1 ? "" : "s"}`;
/** A pose of geometry_msgs as [x, y, theta]. */
export const flat = ({ position: { x, y }, orientation: { z, w } }) => [
  x,
  y,
  Math.atan2(2 * w * z, 1 - 2 * z * z),
];
export const seconds = ({ secs, nsecs }) => secs + nsecs / 1e9;
/** GET, or with data POST, unless the method is given; throws what is wrong. */
export async function request(
  path,
  data = undefined,
  method = data ? "POST" : "GET",
) {
  const headers = { "Content-Type": "application/json" };
  const answer = await fetch(path, {
    method,
    headers,
    body: JSON.stringify(data),
  }).catch(() => null);
  const result = await answer?.json().catch(() => null);
  if (!answer?.ok || !result)
    throw new Error(result?.error ?? "the server does not answer");
  return result;
}
