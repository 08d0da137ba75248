// @ts-check
/** Language, location, installing, privacy. */

import { button, h, iconButton } from "../dom.js";
import { icon } from "../icons.js";
import { LANGUAGES } from "../texts.js";
import { locationQuestion } from "./suggestion.js";

/** @typedef {import("../app.js").App} App */

/**
 * Fill the dialog and open it.
 * @param {App} app
 * @param {HTMLDialogElement} dialog
 */
export function openMenu(app, dialog) {
  const { texts } = app;
  const close = () => dialog.close();
  const install = app.installer;
  dialog.replaceChildren(
    h("div", { class: "top" }, h("h2", { id: "dialog-title" }, texts.say("menu")), iconButton("cross", texts.say("close"), close)),
    h("h3", { id: "language-title" }, texts.say("language")),
    h("div", { class: "choices", role: "group", "aria-labelledby": "language-title" }, ...languages(app, close)),
    h("h3", {}, texts.say("location")),
    location(app, close),
    ...(install ? [button("download", texts.say("install"), () => app.install(), { class: "wide" })] : []),
    h("a", { href: "#privacy", class: "button wide", onclick: close }, icon("shield"), h("span", {}, texts.say("privacy"))),
  );
  dialog.showModal();
}

/**
 * @param {App} app
 * @param {() => void} close
 */
function languages(app, close) {
  return Object.entries(LANGUAGES).map(([code, name]) => {
    const chosen = String(code === app.texts.language);
    const choose = () => {
      close();
      app.speak(code);
    };
    return h("button", { type: "button", lang: code, "aria-pressed": chosen, onclick: choose }, name);
  });
}

/**
 * @param {App} app
 * @param {() => void} close
 */
function location(app, close) {
  const { texts, whereabouts } = app;
  const question = locationQuestion(app);
  if (question) {
    question.querySelector("button")?.addEventListener("click", close);
    return question;
  }
  if (!whereabouts.geolocation) return h("p", { class: "quiet" }, texts.say("location.denied"));
  const stop = () => {
    close();
    app.stopLocating();
  };
  return h("div", {}, h("p", { class: "quiet" }, texts.say("location.on")), button("cross", texts.say("location.stop"), stop, { class: "wide" }));
}
