// @ts-check
/** Opening hours, in Brussels, wherever the visitor's clock is. */

/** @typedef {[opens: number, closes: number][][]} Hours per weekday from Monday, minutes; past 1440: the night after */

const DAY = 24 * 60; // minutes
const CLOCK = new Intl.DateTimeFormat("en-GB", {
  timeZone: "Europe/Brussels", weekday: "short", hour: "2-digit", minute: "2-digit", hourCycle: "h23",
});
const WEEKDAYS = ["Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun"];

/**
 * What the clocks of Brussels show; the weekday counts from Monday, 0.
 * @param {Date} now
 */
export function localTime(now) {
  const parts = Object.fromEntries(CLOCK.formatToParts(now).map(({ type, value }) => [type, value]));
  return { weekday: WEEKDAYS.indexOf(parts.weekday), hour: Number(parts.hour), minute: Number(parts.minute) };
}

/**
 * Whether a place is open; one with unknown hours is.
 * @param {Hours | null | undefined} hours
 * @param {Date} now
 */
export function isOpen(hours, now) {
  return !hours || spanAt(hours, now) !== null;
}

/**
 * What to say of the hours.
 * @param {Hours | null | undefined} hours
 * @param {Date} now
 * @returns {{state: "unknown" | "always"} | {state: "open" | "opens", time: string} | {state: "closed"}} `time` as 18:30
 */
export function describe(hours, now) {
  if (!hours) return { state: "unknown" };
  if (hours.every((spans) => spans.some(([opens, closes]) => opens === 0 && closes >= DAY))) return { state: "always" };
  const span = spanAt(hours, now);
  if (span) return { state: "open", time: clock(span[1]) };
  const { weekday, hour, minute } = localTime(now);
  const later = hours[weekday].map(([opens]) => opens).filter((opens) => opens > 60 * hour + minute);
  return later.length ? { state: "opens", time: clock(Math.min(...later)) } : { state: "closed" };
}

/**
 * The span of today, or of the night since yesterday, that lasts now.
 * @param {Hours} hours
 * @param {Date} now
 */
function spanAt(hours, now) {
  const { weekday, hour, minute } = localTime(now);
  const yesterday = hours[(weekday + 6) % 7].map(([opens, closes]) => [opens - DAY, closes - DAY]);
  const at = 60 * hour + minute;
  return [...hours[weekday], ...yesterday].find(([opens, closes]) => opens <= at && at < closes) ?? null;
}

/** @param {number} minutes since midnight */
function clock(minutes) {
  const pad = (/** @type {number} */ number) => String(number).padStart(2, "0");
  return `${pad(Math.floor(minutes / 60) % 24)}:${pad(minutes % 60)}`;
}
