// What all parts of the page use.

/** The server's state, which is null without a connection; see docs/web.md. */
export const server = {state: null};

export const find = (id) => document.getElementById(id);

export const element = (kind, textContent, className = "") =>
  Object.assign(document.createElement(kind), {textContent, className});

/** Change a text only if it differs: screen readers read each change. */
export const say = (id, text) => find(id).textContent === text || (find(id).textContent = text);

export const poseText = (pose) =>
  pose.map((value, i) => `${value.toFixed(3)} ${["m", "m", "rad"][i]}`).join(", ");

/** GET, POST or DELETE; returns the JSON of the answer, or throws what is wrong. */
export async function request(path, method = "GET", data = undefined) {
  const headers = data && {"Content-Type": "application/json"};
  const options = {method, headers, body: data && JSON.stringify(data)};
  const answer = await fetch(path, options).catch(() => null);
  const result = await answer?.json().catch(() => null);
  if (!answer?.ok || !result) throw new Error(result?.error ?? "the server does not answer");
  return result;
}
