// @ts-check
/** What is sent and kept, and a button that deletes it. */

import { button, h, link } from "../dom.js";

/** @typedef {import("../app.js").App} App */

/** @param {App} app */
export function privacyPage(app) {
  const { texts, config } = app;
  const part = (/** @type {string} */ key, /** @type {Node[]} */ ...more) => [h("h3", {}, texts.say(key)), ...more];
  const kept = ["here", "server", "agent"].map((where) =>
    h("p", {}, texts.say(`privacy.kept.${where}`, { days: config.sessionDays })),
  );
  return h(
    "article",
    { class: "card prose" },
    h("h2", { tabindex: -1 }, texts.say("privacy.title")),
    ...part("privacy.sent", h("p", {}, texts.say("privacy.sent.text"))),
    ...part("privacy.kept", ...kept),
    ...part("privacy.others", ...others(app).map((sentence) => h("p", {}, sentence))),
    ...(config.live ? [livePage(app, config.live)] : []),
    forgetting(app),
    ...part("credits", h("p", {}, texts.say("credits.text", { count: app.places.list.length }))),
  );
}

/**
 * The servers that the page asks beside Shepherd.
 * @param {App} app
 */
function others({ texts, config }) {
  const sentences = [];
  if (config.tiles) sentences.push(texts.say("privacy.others.tiles", { host: hostOf(config.tiles.url) }));
  if (config.routing) sentences.push(texts.say("privacy.others.routing", { host: hostOf(config.routing) }));
  return sentences.length ? sentences : [texts.say("privacy.others.none")];
}

/**
 * What all visitors together have loved.
 * @param {App} app
 * @param {string} address on the server
 */
function livePage({ texts, config }, address) {
  return link("heart", texts.say("live"), new URL(address, config.server).href);
}

/** Asks once more. @param {App} app */
function forgetting(app) {
  const { texts } = app;
  const box = h("div", { class: "forgetting" });
  const first = button("bin", texts.say("forget"), () => box.replaceChildren(...sure), { class: "wide" });
  const sure = [
    h("p", {}, texts.say("forget.sure")),
    button("bin", texts.say("forget"), () => app.forget(), { class: "wide danger" }),
    button("back", texts.say("forget.cancel"), () => box.replaceChildren(first), { class: "wide" }),
  ];
  box.append(first);
  return box;
}

/** @param {string} address may have {braces} in it */
function hostOf(address) {
  return address.split("/")[2] ?? address;
}
