/** Types of the client of Shepherd; what everything does is said in shepherd-client.js. */

/** n is Discrete(n); [shape, low, high] is a Box; an object of those is a Dict. */
export type Space = number | [shape: number[], low: Bound, high: Bound] | { [key: string]: Space };
export type Bound = number | Bound[];

export type TypedArray =
  | Int8Array | Uint8Array | Uint8ClampedArray | Int16Array | Uint16Array | Int32Array | Uint32Array
  | Float32Array | Float64Array;
export type Numbers = number | TypedArray | readonly Numbers[];
export type Observation = Numbers | { readonly [key: string]: Numbers };

/** A number for Discrete(n), nested lists of numbers for a Box. */
export type Action = number | NestedNumbers;
export type NestedNumbers = Array<number | NestedNumbers>;

export interface Agent {
  name: string;
  algorithm: string;
  action_space: Space;
  observation_space: Space;
}

export interface ClientOptions {
  /** Of the server; default http://127.0.0.1:8000. */
  url?: string;
  /** Seconds for which a request is repeated while the server cannot be reached or asks to wait; default 60. */
  patience?: number;
  /** Seconds that one attempt may take; default 30. */
  timeout?: number;
}

export interface ActOptions {
  /** Anything; kept by the server for the algorithm. */
  info?: Record<string, unknown>;
  /** Which actions are allowed here, for algorithms that heed it. */
  actionMask?: readonly boolean[];
  /** What a person or a heuristic at the client would do here. */
  advice?: unknown;
  signal?: AbortSignal;
}

export interface ObserveOptions {
  /** The task is over. */
  terminated?: boolean;
  /** Only the time is up. */
  truncated?: boolean;
  signal?: AbortSignal;
}

export interface StepOptions extends ActOptions, ObserveOptions {
  /** Of the action before. */
  reward?: number;
}

export interface Reply {
  /** null after the end of an episode. */
  action: Action | null;
  seq: number;
  /** The sum of the episode's rewards, after its end. */
  episodeReturn: number | null;
}

export const DEFAULT_URL: string;

export class Client {
  constructor(apiKey: string, options?: ClientOptions);
  session(options?: { signal?: AbortSignal }): Promise<Session>;
  resume(key: string, seq: number): Session;
}

export class Session {
  private constructor();
  readonly key: string;
  readonly seq: number;
  readonly agent: Agent | null;
  step(obs: Observation, options?: StepOptions): Promise<Reply>;
  /** The type of the action is known to you, from the agent's action space: `session.act<number>(obs)`. */
  act<A extends Action = Action>(obs: Observation, options?: ActOptions): Promise<A>;
  observe(obs: Observation, reward: number, options?: ObserveOptions): Promise<number | null>;
  close(options?: { signal?: AbortSignal }): Promise<void>;
}

export class ShepherdError extends Error {
  constructor(message: string, answer?: { code?: string; status?: number; retryAfter?: number | null });
  static code: string;
  readonly code: string;
  /** Of HTTP; 0 when no answer came. */
  readonly status: number;
  /** Seconds. */
  readonly retryAfter: number | null;
}
export class TransientError extends ShepherdError {}
export class ConnectionLost extends TransientError {}
export class Unavailable extends TransientError {}
export class StepPending extends TransientError {}
export class QuotaExceeded extends TransientError {}
export class Throttled extends TransientError {}
export class NoCapacity extends TransientError {}
export class ExecutionLost extends TransientError {}
export class InvalidApiKey extends ShepherdError {}
export class UnknownSession extends ShepherdError {}
export class Forbidden extends ShepherdError {}
export class NotFound extends ShepherdError {}
export class MethodNotAllowed extends ShepherdError {}
export class RequestTooLarge extends ShepherdError {}
export class InvalidObservation extends ShepherdError {}
export class InvalidReward extends ShepherdError {}
export class InvalidRequest extends ShepherdError {}
export class SequenceGap extends ShepherdError {}
export class InternalError extends ShepherdError {}
export class UnexpectedReply extends ShepherdError {}
