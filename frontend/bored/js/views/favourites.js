// @ts-check
/** The places that the visitor loves. */

import { h, iconButton } from "../dom.js";
import { icon } from "../icons.js";

/** @typedef {import("../app.js").App} App */

/** @param {App} app */
export function favouritesList(app) {
  const { texts, visitor } = app;
  const rows = visitor.favourites.map((place) => row(app, place));
  const none = h("p", { class: "quiet" }, texts.say("favourites.none"));
  const title = h("h2", { tabindex: -1 }, texts.say("favourites.title"));
  return h("article", { class: "card list" }, title, rows.length ? h("ul", { class: "rows" }, ...rows) : none);
}

/**
 * @param {App} app
 * @param {import("../places.js").Place} place
 */
function row(app, place) {
  const { texts, places } = app;
  const name = places.name(place, texts.language);
  const open = h("a", { href: `#place/${place.id}` });
  open.append(h("strong", {}, name), h("span", {}, places.address(place, texts.language)));
  return h(
    "li",
    {},
    h("span", { class: `badge ${place.type}` }, icon(place.type)),
    open,
    iconButton("map", texts.say("favourites.on-map", { name }), () => app.map.focus(place)),
    iconButton("share", texts.say("favourites.share", { name }), () => app.share(place)),
    iconButton("bin", texts.say("favourites.remove", { name }), () => app.removeFavourite(place)),
  );
}
