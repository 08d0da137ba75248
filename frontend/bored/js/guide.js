// @ts-check
/**
 * The conversation with the agent. A suggestion is an episode of one step: the agent sees an observation and decides, the
 * visitor's answer ends the episode (docs/bored.md).
 *
 * A visitor has up to two sessions, here called seats: while the answer to one suggestion is still held back, so that it can
 * be taken back, the next one is asked for in the other seat. Everything is remembered before it is sent, so that a reload or
 * a lost connection loses no answer; the client's `seq` makes repeating harmless.
 */

import {
  InvalidObservation, InvalidRequest, SequenceGap, ShepherdError, TransientError, UnknownSession,
} from "../vendor/shepherd-client.js";

/** @typedef {import("./store.js").Seat} Seat */

const SEATS = 2;
const LOST = [UnknownSession, SequenceGap, InvalidObservation, InvalidRequest]; // another session helps

export class Guide {
  /** @type {Promise<unknown>} */
  #last = Promise.resolve();
  /** Key of the seat whose answer is held back for now. @type {string | null} */
  held = null;

  /**
   * @param {import("../vendor/shepherd-client.js").Client} client
   * @param {import("./store.js").Store} store
   */
  constructor(client, store) {
    this.client = client;
    this.store = store;
  }

  /**
   * Ask for a place; answers that wait, and are not held back, are sent first. Throws what the client throws.
   * @param {number[]} obs
   * @param {boolean[]} mask
   * @returns {Promise<{action: number, session: string}>} the place's number, and the key of the seat that decided
   */
  suggest(obs, mask) {
    return this.#alone(async () => {
      await this.#settle();
      try {
        return await this.#ask(obs, mask);
      } catch (error) {
        if (!isLost(error)) throw error;
        return await this.#ask(obs, mask); // in a new seat
      }
    });
  }

  /**
   * Note the visitor's answer to the suggestion of a seat; `settle()` sends it.
   * @param {string | null} session key of the seat; null: chance had decided, and nobody learns
   * @param {0 | 1 | null} answer null takes it back
   */
  answer(session, answer) {
    this.#update(session, { answer });
  }

  /** Send the answers that wait and are not held back. Returns whether they have arrived. */
  settle() {
    return this.#alone(async () => {
      try {
        await this.#settle();
        return true;
      } catch (error) {
        if (error instanceof ShepherdError) return false; // they wait for the next time
        throw error;
      }
    });
  }

  /** Close all sessions at the server. Returns whether that was possible; if not, `sweep()` tries again. */
  leave() {
    this.store.change((memory) => {
      memory.closing.push(...memory.seats.map(({ key }) => key));
      memory.seats = [];
    });
    return this.sweep();
  }

  /** Close the sessions that nobody uses any more. Returns whether all are closed. */
  sweep() {
    return this.#alone(async () => {
      const left = await Promise.all(this.store.read().closing.map((key) => this.#close(key)));
      this.store.change((memory) => {
        memory.closing = left.filter((key) => key !== null);
      });
      return left.every((key) => key === null);
    });
  }

  /**
   * @param {string} key
   * @returns {Promise<string | null>} the key, when it could not be closed
   */
  async #close(key) {
    try {
      await this.client.resume(key, 0).close();
      return null;
    } catch (error) {
      return error instanceof TransientError ? key : null; // any other: there is no such session
    }
  }

  /**
   * @param {number[]} obs
   * @param {boolean[]} mask
   */
  async #ask(obs, mask) {
    const seat = this.store.read().seats.find((one) => one.obs === null) ?? (await this.#sit());
    const { action } = await this.#step(seat, obs, { actionMask: mask });
    this.#update(seat.key, { obs, answer: null });
    return { action: Number(action), session: seat.key };
  }

  /** A new seat; of those that have waited too long for an answer, the oldest makes room. */
  async #sit() {
    const { key, seq } = await this.client.session();
    const seat = { key, seq, obs: null, answer: null };
    this.store.change((memory) => {
      memory.seats.push(seat);
      memory.closing.push(...memory.seats.splice(0, memory.seats.length - SEATS).map((old) => old.key));
    });
    return seat;
  }

  async #settle() {
    for (const seat of this.store.read().seats) {
      if (seat.obs === null || seat.answer === null || seat.key === this.held) continue;
      try {
        await this.#step(seat, seat.obs, { reward: seat.answer, terminated: true });
        this.#update(seat.key, { obs: null, answer: null });
      } catch (error) {
        if (!isLost(error)) throw error; // else the answer went with its session
      }
    }
  }

  /**
   * @param {Seat} seat
   * @param {number[]} obs
   * @param {import("../vendor/shepherd-client.js").StepOptions} options
   */
  async #step(seat, obs, options) {
    try {
      const reply = await this.client.resume(seat.key, seat.seq).step(obs, options);
      this.#update(seat.key, { seq: reply.seq });
      return reply;
    } catch (error) {
      if (isLost(error)) this.#drop(seat);
      throw error;
    }
  }

  /**
   * @param {string | null} session
   * @param {Partial<Seat>} change
   */
  #update(session, change) {
    this.store.change(({ seats }) => {
      const seat = seats.find(({ key }) => key === session);
      if (seat) Object.assign(seat, change);
    });
  }

  /** @param {Seat} seat */
  #drop(seat) {
    this.store.change((memory) => {
      memory.seats = memory.seats.filter(({ key }) => key !== seat.key);
    });
  }

  /**
   * One after the other, in all tabs of this page: a session takes one step at a time.
   * @template T
   * @param {() => Promise<T>} work
   * @returns {Promise<T>}
   */
  #alone(work) {
    const locked = async () => (await globalThis.navigator?.locks?.request("bored-in-the-city", work)) ?? work();
    const mine = this.#last.then(locked, locked);
    this.#last = mine.catch(() => {});
    return mine;
  }
}

/** @param {unknown} error */
function isLost(error) {
  return LOST.some((kind) => error instanceof kind);
}
