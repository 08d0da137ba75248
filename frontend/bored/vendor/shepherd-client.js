// @ts-check
/**
 * The client of Shepherd, reinforcement learning as a service, for browsers and Node 20 or later.
 *
 *     import { Client } from "./shepherd-client.js";
 *
 *     const session = await new Client("sk_...", { url: "http://127.0.0.1:8000" }).session();
 *     const action = await session.act(observation);
 *     await session.observe(nextObservation, reward);
 *
 * Errors:
 *
 * ShepherdError
 * ├── TransientError             the client has repeated the request until its patience ended
 * │   ├── ConnectionLost     -   is the server running, is the URL right? then repeat the step
 * │   ├── Unavailable       503  Shepherd, or what stands before it, cannot serve now; repeat the step
 * │   ├── StepPending       409  another program steps this session, or the first answer takes too long; repeat the step
 * │   ├── QuotaExceeded     429  the agent has used its share of the CPU; repeat the step later
 * │   ├── Throttled         429  too many requests; repeat the step later
 * │   ├── NoCapacity        503  no execution is free; repeat the step later
 * │   └── ExecutionLost     503  the execution ended; repeat the step
 * ├── InvalidApiKey         401  use a valid API key
 * ├── UnknownSession        401  log in again
 * ├── Forbidden             403  use a key with the scope that is needed
 * ├── NotFound              404  mend the URL
 * ├── MethodNotAllowed      405  mend the URL
 * ├── RequestTooLarge       413  send smaller observations
 * ├── InvalidObservation    422  mend the observation; the session goes on
 * ├── InvalidReward         422  mend the reward; the session goes on
 * ├── InvalidRequest        422  mend the request; the session goes on
 * ├── SequenceGap           409  another program has stepped this session; log in again, or resume with its `seq`
 * ├── InternalError         500  report it to whoever runs the server; the session goes on
 * └── UnexpectedReply        -   this is not a Shepherd server; mend the URL
 */

/** No action came. `code` is the server's stable name of the error, the message says what to do. */
export class ShepherdError extends Error {
  static code = "error";

  /**
   * @param {string} message
   * @param {{code?: string, status?: number, retryAfter?: number | null}} [answer]
   */
  constructor(message, { code, status = 0, retryAfter = null } = {}) {
    super(message);
    this.name = new.target.name;
    this.code = code || new.target.code;
    this.status = status; // of HTTP; 0 when no answer came
    this.retryAfter = retryAfter; // seconds
  }
}

export class TransientError extends ShepherdError {}
export class ConnectionLost extends TransientError { static code = "connection_lost"; }
export class Unavailable extends TransientError { static code = "unavailable"; }
export class StepPending extends TransientError { static code = "step_pending"; }
export class QuotaExceeded extends TransientError { static code = "quota_exceeded"; }
export class Throttled extends TransientError { static code = "throttled"; }
export class NoCapacity extends TransientError { static code = "no_capacity"; }
export class ExecutionLost extends TransientError { static code = "execution_lost"; }
export class InvalidApiKey extends ShepherdError { static code = "invalid_api_key"; }
export class UnknownSession extends ShepherdError { static code = "unknown_session"; }
export class Forbidden extends ShepherdError { static code = "forbidden"; }
export class NotFound extends ShepherdError { static code = "not_found"; }
export class MethodNotAllowed extends ShepherdError { static code = "method_not_allowed"; }
export class RequestTooLarge extends ShepherdError { static code = "request_too_large"; }
export class InvalidObservation extends ShepherdError { static code = "invalid_observation"; }
export class InvalidReward extends ShepherdError { static code = "invalid_reward"; }
export class InvalidRequest extends ShepherdError { static code = "invalid_request"; }
export class SequenceGap extends ShepherdError { static code = "sequence_gap"; }
export class InternalError extends ShepherdError { static code = "internal_error"; }
export class UnexpectedReply extends ShepherdError { static code = "unexpected_reply"; }

const BY_CODE = new Map(
  [
    ConnectionLost, Unavailable, StepPending, QuotaExceeded, Throttled, NoCapacity, ExecutionLost,
    InvalidApiKey, UnknownSession, Forbidden, NotFound, MethodNotAllowed, RequestTooLarge,
    InvalidObservation, InvalidReward, InvalidRequest, SequenceGap, InternalError, UnexpectedReply,
  ].map((kind) => [kind.code, kind]),
);
/** @type {Map<number, typeof ShepherdError>} */
const BY_STATUS = new Map([[429, Throttled], [502, Unavailable], [503, Unavailable], [504, Unavailable]]);

export const DEFAULT_URL = "http://127.0.0.1:8000";
const FIRST_PAUSE = 0.05; // seconds between attempts, doubled up to the longest
const LONGEST_PAUSE = 5;
const JITTER = 0.5; // pauses are lengthened by up to this share, so that many clients do not come back at once
const SOON_TOLD = 1; // seconds of waiting after which the console is told why
const CLOSING_PATIENCE = 5; // seconds; a session that is not closed ends by itself later

/** Opens sessions with one agent. */
export class Client {
  /** @type {Settings} */
  #settings;
  #apiKey;

  /**
   * @param {string} apiKey
   * @param {import("./shepherd-client.js").ClientOptions} [options]
   */
  constructor(apiKey, { url = DEFAULT_URL, patience = 60, timeout = 30 } = {}) {
    this.#apiKey = apiKey;
    this.#settings = { url: new URL(url).href.replace(/\/+$/, ""), patience, timeout };
  }

  /**
   * Log in.
   * @param {{signal?: AbortSignal}} [options]
   */
  async session({ signal } = {}) {
    const reply = await request(this.#settings, "POST", "/api/v1/sessions", this.#apiKey, { signal });
    return new Session(this.#settings, reply.session_key, 0, reply.agent);
  }

  /**
   * The session of another page or process, by its `key` and the `seq` of the last reply that it got.
   * @param {string} key
   * @param {number} seq
   */
  resume(key, seq) {
    return new Session(this.#settings, key, seq, null);
  }
}

/**
 * One conversation with an agent, for one environment. Either send every step yourself with `step()`, or let `act()` and
 * `observe()` do the book-keeping. Wait for each before the next.
 */
export class Session {
  #settings;
  #reward = 0; // since the last step, for act() and observe()
  #closed = false;

  /**
   * @param {Settings} settings
   * @param {string} key
   * @param {number} seq
   * @param {import("./shepherd-client.js").Agent | null} agent
   */
  constructor(settings, key, seq, agent) {
    this.#settings = settings;
    this.key = key; // with `seq`, all that Client.resume() needs
    this.seq = seq; // of the last answered step
    this.agent = agent; // null when resumed
  }

  /**
   * Send an observation, and the reward of the action before it; get the next action.
   *
   * At the end of an episode send its last observation with `terminated` or `truncated`; the reply has no action but the
   * episode's return, and the next step begins an episode. Lost connections and requests to wait are repeated for as long
   * as the client's patience; the server steps once, however often it was asked. After a TransientError repeat the same
   * step; after an Invalid... error mend it.
   *
   * @param {unknown} obs
   * @param {import("./shepherd-client.js").StepOptions} [options]
   * @returns {Promise<import("./shepherd-client.js").Reply>}
   */
  async step(obs, { reward = 0, terminated = false, truncated = false, info, actionMask, advice, signal } = {}) {
    const payload = { obs, reward, terminated, truncated, info, action_mask: actionMask, advice, seq: this.seq + 1 };
    const reply = await request(this.#settings, "POST", "/api/v1/step", this.key, { payload, signal });
    this.seq = reply.seq;
    return { action: reply.action, seq: reply.seq, episodeReturn: reply.episode_return ?? null };
  }

  /**
   * The action for an observation.
   * @param {unknown} obs
   * @param {import("./shepherd-client.js").ActOptions} [options]
   */
  async act(obs, options = {}) {
    const { action } = await this.step(obs, { ...options, reward: this.#reward });
    this.#reward = 0;
    return /** @type {any} */ (action);
  }

  /**
   * What came of the action: kept for the next act(); at an episode's end sent, and the return comes back.
   * Several rewards between two actions are added.
   * @param {unknown} obs
   * @param {number} reward
   * @param {import("./shepherd-client.js").ObserveOptions} [options]
   */
  async observe(obs, reward, { terminated = false, truncated = false, signal } = {}) {
    const total = this.#reward + reward;
    if (!terminated && !truncated) {
      this.#reward = total;
      return null;
    }
    const { episodeReturn } = await this.step(obs, { reward: total, terminated, truncated, signal });
    this.#reward = 0; // only now: after an error the same call may be repeated
    return episodeReturn;
  }

  /**
   * End the session. Doing so twice does no harm; a page may call it while it is left.
   * @param {{signal?: AbortSignal}} [options]
   */
  async close({ signal } = {}) {
    if (this.#closed) return;
    this.#closed = true;
    const settings = { ...this.#settings, patience: Math.min(this.#settings.patience, CLOSING_PATIENCE) };
    try {
      await request(settings, "DELETE", "/api/v1/session", this.key, { signal, keepalive: true });
    } catch (error) {
      if (!(error instanceof UnknownSession)) throw error;
    }
  }
}

/**
 * @typedef {{url: string, patience: number, timeout: number}} Settings
 * @typedef {{payload?: object, signal?: AbortSignal, keepalive?: boolean}} Sending
 */

/**
 * The reply, after as many attempts as the patience allows. The `seq` in a step makes repeating it harmless.
 * @param {Settings} settings
 * @param {string} method
 * @param {string} path
 * @param {string} key
 * @param {Sending} sending
 * @returns {Promise<any>}
 */
async function request(settings, method, path, key, sending) {
  const waiting = new Patience(settings.patience);
  for (;;) {
    try {
      return await attempt(settings, method, path, key, sending);
    } catch (error) {
      if (!(error instanceof TransientError)) throw error;
      await sleep(waiting.pause(error), sending.signal);
    }
  }
}

/** The pauses between the attempts of one request. It ends `seconds` after the first failure. */
class Patience {
  #seconds;
  #least = FIRST_PAUSE;
  /** @type {number | null} */
  #began = null;
  #told = false;

  /** @param {number} seconds */
  constructor(seconds) {
    this.#seconds = seconds;
  }

  /**
   * Seconds until the next attempt. Throws `error` when that would be past the end.
   * @param {TransientError} error
   */
  pause(error) {
    const pause = (error.retryAfter ?? this.#least) * (1 + JITTER * Math.random());
    this.#least = Math.min(2 * this.#least, LONGEST_PAUSE);
    this.#began ??= now();
    const waited = now() + pause - this.#began;
    if (waited > this.#seconds) throw error;
    if (waited > SOON_TOLD && !this.#told) {
      this.#told = true;
      console.warn(`${error.message} Trying again for up to ${this.#seconds} seconds.`);
    }
    return pause;
  }
}

/**
 * @param {Settings} settings
 * @param {string} method
 * @param {string} path
 * @param {string} key
 * @param {Sending} sending
 */
async function attempt({ url, timeout }, method, path, key, { payload, signal, keepalive }) {
  signal?.throwIfAborted();
  const body = payload && JSON.stringify(payload, plain);
  const headers = new Headers({ Authorization: `Bearer ${key}` });
  if (body) headers.set("Content-Type", "application/json");
  const limit = new AbortController();
  const timer = setTimeout(() => limit.abort(), timeout * 1000);
  const abort = () => limit.abort();
  signal?.addEventListener("abort", abort);
  let response, text;
  try {
    response = await fetch(url + path, { method, headers, body, keepalive, signal: limit.signal });
    text = await response.text();
  } catch (error) {
    signal?.throwIfAborted();
    throw new ConnectionLost(`No answer from ${url}: ${limit.signal.aborted ? "it took too long" : reason(error)}.`);
  } finally {
    clearTimeout(timer);
    signal?.removeEventListener("abort", abort);
  }
  return understand(response, text, url);
}

/**
 * The reply's object, or the typed error of an answer that is no success (RFC 9457), by its code, else by its status.
 * @param {Response} response
 * @param {string} text
 * @param {string} url
 */
function understand(response, text, url) {
  if (response.status === 204) return {};
  const reply = parse(text);
  if (response.ok && reply) return reply;
  const { code, detail } = reply ?? {};
  const kind = BY_CODE.get(code) ?? BY_STATUS.get(response.status) ?? (code ? ShepherdError : UnexpectedReply);
  const message = detail ?? `${url} answered ${response.status}, which is no answer of Shepherd: is the URL right?`;
  const wait = reply?.retry_after ?? response.headers.get("Retry-After"); // the header has whole seconds only
  throw new kind(message, { code, status: response.status, retryAfter: seconds(wait) });
}

/** @param {string} text */
function parse(text) {
  try {
    const value = JSON.parse(text);
    return value !== null && typeof value === "object" ? value : null;
  } catch {
    return null;
  }
}

/** Seconds as the server wrote them; a date is not understood. @param {unknown} value */
function seconds(value) {
  const number = value === null ? NaN : Number(value);
  return Number.isFinite(number) ? Math.max(0, number) : null;
}

/** Typed arrays as lists; JSON would make objects of them. @param {string} _ @param {any} value */
function plain(_, value) {
  return ArrayBuffer.isView(value) && !(value instanceof DataView) ? Array.from(/** @type {any} */ (value)) : value;
}

/** @param {any} error */
function reason(error) {
  return error.cause?.code ?? error.cause?.message ?? error.message;
}

function now() {
  return performance.now() / 1000;
}

/** @param {number} duration in seconds @param {AbortSignal} [signal] */
function sleep(duration, signal) {
  return new Promise((resolve, reject) => {
    const abort = () => {
      clearTimeout(timer);
      reject(signal?.reason);
    };
    const timer = setTimeout(() => {
      signal?.removeEventListener("abort", abort);
      resolve(undefined);
    }, duration * 1000);
    signal?.addEventListener("abort", abort, { once: true });
  });
}
