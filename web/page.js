// Small helpers for the elements of the page.

export const find = (id) => document.getElementById(id);

/** An element with a text and a class. */
export function element(kind, text, name = "") {
  return Object.assign(document.createElement(kind), {textContent: text, className: name});
}

/** Call a function at each of these events, which are separated by spaces. */
export function listen(target, events, callback) {
  events.split(" ").forEach((each) => target.addEventListener(each, callback));
}

/** Change a text only if it differs: screen readers read each change. */
export function say(id, text) {
  if (find(id).textContent !== text) find(id).textContent = text;
}
