// @ts-check
/** What whoever serves the page has set: config.json, made by Shepherd, or a file on any other host (README.md). */

/**
 * @typedef {object} Config
 * @property {string} server address of Shepherd
 * @property {string | null} key publishable API key of the agent; null: there is no agent, and chance decides
 * @property {import("./map.js").Tiles | null} tiles of a map server; null: only the drawing
 * @property {string | null} routing address of a routing service that speaks as OSRM does; null: straight lines
 * @property {string} map what is drawn: sketch.json, or streets that an operator has imported
 * @property {string | null} live address of the agent's live page, if everybody may see it
 * @property {number} sessionDays days without a visit after which the server closes a session
 */

/** @type {Omit<Config, "server">} */
const DEFAULTS = { key: null, tiles: null, routing: null, map: "sketch.json", live: null, sessionDays: 30 };

/** @returns {Promise<Config>} */
export async function loadConfig() {
  const response = await fetch("config.json");
  const told = response.ok ? await response.json() : {};
  return { ...DEFAULTS, ...told, server: told.server || location.origin };
}
