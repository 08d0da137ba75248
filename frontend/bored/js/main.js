// @ts-check
/** Puts the page together. */

import { Client } from "../vendor/shepherd-client.js";
import { App } from "./app.js";
import { loadConfig } from "./config.js";
import { Guide } from "./guide.js";
import { CityMap } from "./map.js";
import { Places } from "./places.js";
import { browserStorage, Store } from "./store.js";
import { chooseLanguage, Texts } from "./texts.js";
import { Visitor } from "./visitor.js";
import { Whereabouts } from "./whereabouts.js";

const PATIENCE = 2.5; // seconds for which a request is repeated; then chance decides
const TIMEOUT = 8; // seconds

/** @typedef {import("./app.js").Installer} Installer */

/** @param {string} file */
const loadJson = async (file) => (await fetch(file)).json();

async function start() {
  const store = new Store(browserStorage());
  const language = chooseLanguage([store.read().language, ...navigator.languages]);
  const [config, places, texts] = await Promise.all([loadConfig(), Places.load("places.json"), Texts.load(language)]);
  const drawing = await loadJson(config.map).catch(() => loadJson("sketch.json"));
  const whereabouts = new Whereabouts(navigator.geolocation, store, places);
  const options = { url: config.server, patience: PATIENCE, timeout: TIMEOUT };
  const guide = config.key ? new Guide(new Client(config.key, options), store) : null;
  const visitor = new Visitor({ places, store, whereabouts, guide });
  const map = new CityMap(/** @type {HTMLElement} */ (document.getElementById("map")), config.tiles, places.attribution);
  const app = new App({ config, places, store, whereabouts, visitor, map, drawing, texts });
  app.translate();
  app.show(false);
  tend(app, guide);
}

/**
 * What happens beside the visitor's doing.
 * @param {App} app
 * @param {Guide | null} guide
 */
function tend(app, guide) {
  const settle = () => void app.visitor.settle();
  settle(); // answers of the last visit
  void guide?.sweep();
  if (app.store.read().locate) void app.whereabouts.start();
  addEventListener("online", settle);
  addEventListener("beforeinstallprompt", (event) => {
    event.preventDefault();
    app.installer = /** @type {Installer} */ (event);
  });
  addEventListener("load", () => void navigator.serviceWorker?.register("sw.js").catch(() => {}));
  if (document.readyState === "complete") dispatchEvent(new Event("load"));
}

start().catch((error) => {
  console.error(error);
  const panel = document.getElementById("panel");
  if (panel) panel.textContent = "Offline? This page could not be loaded. · Page non chargée. · Pagina niet geladen.";
});
