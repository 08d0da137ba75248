// @ts-check
/** Asking the server, again and again. */

const EVERY = 2000; // ms
const SOON = 200;

/**
 * @param {string} url
 * @param {Record<string, string | number>} [parameters]
 * @returns {Promise<any>}
 */
export async function ask(url, parameters = {}) {
  const query = new URLSearchParams(Object.entries(parameters).map(([name, value]) => [name, String(value)]));
  const answer = await fetch(`${url}?${query}`, { headers: { Accept: "application/json" }, redirect: "error" });
  if (!answer.ok) throw new Error(`The server answered ${answer.status}.`);
  return answer.json();
}

/**
 * Do it now and every few seconds, while the page is seen. It must not fail.
 * @param {() => Promise<unknown>} work
 * @param {() => boolean} [hurried] whether there is more at once
 */
export async function forever(work, hurried = () => false) {
  if (!document.hidden) await work();
  setTimeout(forever, hurried() ? SOON : EVERY, work, hurried);
}
