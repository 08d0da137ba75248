// @ts-check
/** One place: what it is, how far, why, and what to do with it. */

import { button, h, link } from "../dom.js";
import { findWay, openStreetMap, ownMap } from "../directions.js";
import { estimateWalk } from "../distance.js";
import { describe } from "../hours.js";
import { icon } from "../icons.js";
import { pointOf } from "../places.js";

/** @typedef {import("../app.js").App} App */
/** @typedef {import("../places.js").Place} Place */
/** @typedef {import("../contract.js").Point} Point */

/**
 * @param {App} app
 * @param {Place} place
 * @param {Point} from where the way begins
 * @param {Node[]} actions what can be decided about it
 * @param {Node | null} why
 */
export function placeCard(app, place, from, actions, why) {
  const { texts, places } = app;
  return h(
    "article",
    { class: `card ${place.type}` },
    h("p", { class: "kind" }, icon(place.type), texts.say(`type.${place.type}`)),
    h("h2", { tabindex: -1 }, places.name(place, texts.language)),
    h("address", {}, places.address(place, texts.language)),
    facts(app, place, from),
    why,
    h("div", { class: "actions" }, ...actions),
    directions(app, place, from),
    h(
      "p",
      { class: "links" },
      place.website ? link("web", texts.say("website"), place.website) : null,
      link("map", texts.say("osm"), openStreetMap(pointOf(place))),
      button("share", texts.say("share"), () => app.share(place)),
    ),
  );
}

/**
 * @param {App} app
 * @param {import("../store.js").Suggestion} suggestion
 */
export function whyCard({ texts, places }, { id, session, reason }) {
  const place = places.get(id);
  if (!place) return null;
  const { metres } = estimateWalk(reason.here, pointOf(place));
  const share = texts.percent(reason.share);
  const sentences = [
    texts.say(session ? "why.agent" : "why.chance"),
    texts.say("why.kind", { kind: texts.say(`type.${place.type}`) }),
    texts.say(reason.located ? "why.distance" : "why.distance.assumed", { distance: texts.distance(metres) }),
    texts.say(reason.share ? "why.share" : "why.share.none", { share }),
  ];
  const [because, ...known] = sentences;
  return h(
    "details",
    { class: "why" },
    h("summary", {}, icon("why"), texts.say("why")),
    h("p", {}, because),
    h("ul", {}, ...known.map((sentence) => h("li", {}, sentence))),
  );
}

/**
 * @param {App} app
 * @param {Place} place
 * @param {Point} from
 */
function facts({ texts }, place, from) {
  const { minutes, metres } = estimateWalk(from, pointOf(place));
  const hours = describe(place.hours, new Date());
  const time = "time" in hours ? hours.time : "";
  const walk = `${texts.say("walk", { minutes: Math.max(1, Math.round(minutes)) })} · ${texts.distance(metres)}`;
  return h(
    "ul",
    { class: "facts" },
    h("li", {}, icon("walk"), walk),
    hours.state === "unknown" ? null : h("li", { class: hours.state }, icon("clock"), texts.say(hours.state, { time })),
    place.wheelchair ? h("li", {}, icon("wheelchair"), texts.say(`wheelchair.${place.wheelchair}`)) : null,
  );
}

/**
 * The way there, once it is asked for.
 * @param {App} app
 * @param {Place} place
 * @param {Point} from
 */
function directions(app, place, from) {
  const { texts, map } = app;
  const answer = h("div", { class: "way-words", role: "status" });
  const words = h("span", {}, texts.say("directions.show"));
  const toggle = h("button", { type: "button", class: "wide", "aria-expanded": "false" }, icon("route"), words);
  const show = (/** @type {boolean} */ shown) => {
    toggle.setAttribute("aria-expanded", String(shown));
    words.textContent = texts.say(shown ? "directions.hide" : "directions.show");
  };
  toggle.addEventListener("click", async () => {
    if (toggle.getAttribute("aria-expanded") === "true") {
      show(false);
      answer.replaceChildren();
      map.hideWay();
      return;
    }
    show(true);
    const way = await findWay(from, pointOf(place), app.config.routing);
    if (!toggle.isConnected || toggle.getAttribute("aria-expanded") !== "true") return; // another place meanwhile
    map.showWay(way);
    answer.replaceChildren(...wayWords(app, place, from, way));
  });
  return h("div", { class: "directions" }, toggle, answer);
}

/**
 * @param {App} app
 * @param {Place} place
 * @param {Point} from
 * @param {import("../directions.js").Way} way
 */
function wayWords({ texts, places }, place, from, { metres, minutes, estimated }) {
  const walk = { distance: texts.distance(metres), minutes: Math.max(1, Math.round(minutes)) };
  const name = places.name(place, texts.language);
  const own = ownMap(from, pointOf(place), name, navigator.userAgent);
  return [
    h("p", {}, h("strong", {}, texts.say("directions.walk", walk))),
    ...(estimated ? [h("p", { class: "quiet" }, texts.say("directions.estimated"))] : []),
    h("p", {}, link("map", texts.say("directions.own"), own)),
  ];
}
