// @ts-check
/** The first thing one sees: a welcome, then one suggestion after the other. */

import { button, h } from "../dom.js";
import { icon } from "../icons.js";
import { swipeable } from "../swipe.js";
import { placeCard, whyCard } from "./place.js";

/** @typedef {import("../app.js").App} App */

/** @param {App} app */
export function welcome(app) {
  const { texts } = app;
  const next = button("next", texts.say("next"), () => app.next(), { class: "wide primary" });
  return h(
    "article",
    { class: "card welcome" },
    h("h2", { tabindex: -1 }, texts.say("welcome.title")),
    h("p", {}, texts.say("welcome.text")),
    h("div", { class: "actions" }, next),
    locationQuestion(app),
  );
}

/**
 * Why we would like to know, and a button that asks; nothing where it is known already.
 * @param {App} app
 */
export function locationQuestion(app) {
  const { texts, whereabouts } = app;
  if (whereabouts.get().located || !whereabouts.geolocation) return null;
  const ask = button("locate", texts.say("location.ask"), () => app.locate(), { class: "wide" });
  return h("div", { class: "ask" }, ask, h("p", { class: "quiet" }, texts.say("location.why")));
}

/**
 * @param {App} app
 * @param {import("../store.js").Suggestion} suggestion
 */
export function suggestionCard(app, suggestion) {
  const place = app.places.get(suggestion.id);
  if (!place) return welcome(app);
  const decided = suggestion.verdict !== null;
  const actions = decided ? afterwards(app, suggestion.verdict) : decisions(app);
  const card = placeCard(app, place, app.startOf(suggestion), actions, whyCard(app, suggestion));
  if (suggestion.session === null) card.prepend(h("p", { class: "notice" }, app.texts.say("offline")));
  if (!decided) swipeable(card, (loved) => (loved ? app.love() : app.dismiss()));
  return card;
}

/** While a place is looked for. @param {App} app */
export function waiting({ texts }) {
  const lines = ["kind", "name", "line", "line short"].map((name) => h("span", { class: `blank ${name}` }));
  return h("article", { class: "card waiting", "aria-busy": "true" }, h("p", { class: "unseen" }, texts.say("asking")), ...lines);
}

/** @param {App} app */
function decisions(app) {
  const { texts } = app;
  return [
    button("cross", texts.say("dismiss"), () => app.dismiss(), { class: "dismiss" }),
    button("heart", texts.say("love"), () => app.love(), { class: "love" }),
  ];
}

/**
 * @param {App} app
 * @param {string | null} verdict
 */
function afterwards(app, verdict) {
  const { texts } = app;
  const next = button("next", texts.say("next"), () => app.next(), { class: "wide primary" });
  return verdict === "loved" ? [h("p", { class: "loved" }, icon("heart"), texts.say("loved")), next] : [next];
}
