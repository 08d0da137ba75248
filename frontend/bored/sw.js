// @ts-check
/**
 * Keeps the page on the device, so that it opens without a network. What the network answers is shown, and kept; what it does
 * not answer within a moment comes from what was kept. The API, map tiles and ways are none of its business.
 */

const CACHE = "bored-in-the-city";
const PATIENCE = 3000; // ms
const FILES = [
  "./", "config.json", "places.json", "sketch.json", "manifest.webmanifest", "lang/en.json", "lang/fr.json", "lang/nl.json",
  "css/base.css", "css/map.css", "icons/icon.svg", "icons/icon-192.png", "vendor/leaflet/leaflet.js",
  "vendor/leaflet/leaflet.css", "vendor/shepherd-client.js", "js/app.js", "js/config.js", "js/contract.js", "js/directions.js",
  "js/distance.js", "js/dom.js", "js/drawing.js", "js/guide.js", "js/hours.js", "js/icons.js", "js/main.js", "js/map.js",
  "js/places.js", "js/snack.js", "js/store.js", "js/swipe.js", "js/texts.js", "js/visitor.js", "js/whereabouts.js",
  "js/views/favourites.js", "js/views/menu.js", "js/views/place.js", "js/views/privacy.js", "js/views/suggestion.js",
];

/** @type {any} */
const worker = self;

worker.addEventListener("install", (/** @type {any} */ event) => {
  event.waitUntil(caches.open(CACHE).then((cache) => cache.addAll(FILES)).then(() => worker.skipWaiting()));
});

worker.addEventListener("activate", (/** @type {any} */ event) => {
  event.waitUntil(worker.clients.claim());
});

worker.addEventListener("fetch", (/** @type {any} */ event) => {
  const { request } = event;
  if (request.method === "GET" && request.url.startsWith(worker.registration.scope)) event.respondWith(answer(request));
});

/** @param {Request} request */
async function answer(request) {
  const kept = await caches.match(request, { ignoreSearch: request.mode === "navigate" });
  const fresh = fetchAndKeep(request);
  if (!kept) return fresh;
  const late = new Promise((resolve) => setTimeout(resolve, PATIENCE, kept));
  return Promise.race([fresh.catch(() => kept), late]);
}

/** @param {Request} request */
async function fetchAndKeep(request) {
  const response = await fetch(request);
  if (response.ok) (await caches.open(CACHE)).put(request, response.clone());
  return response;
}
