"""Everything that Shepherd can answer instead of an action.

ShepherdError
├── InvalidApiKey        401  log in with a valid API key
├── UnknownSession       401  log in again
├── Forbidden            403  use a key with the scope that is needed, from one of its pages
├── NotFound             404  mend the address
├── MethodNotAllowed     405  use another method
├── RequestTooLarge      413  send less at once
├── InvalidObservation   422  mend the observation
├── InvalidReward        422  mend the reward
├── InvalidRequest       422  mend the request
├── StepPending          409  wait for the first answer
├── SequenceGap          409  send the next number
├── QuotaExceeded        429  wait Retry-After seconds
├── Throttled            429  wait Retry-After seconds
├── NoCapacity           503  repeat the same step after Retry-After
├── ExecutionLost        503  repeat the same step after Retry-After
├── Unavailable          503  repeat the same request after Retry-After
└── InternalError        500  report it; the traceback is in the server's log

`code` is stable and part of the API; `detail` says what the caller should do (DESIGN.md section 5).
"""

from __future__ import annotations


class ShepherdError(Exception):
    """An answer that is no action. `detail` is for people, `retry_after` in seconds."""

    code = "error"
    status = 500
    title = "Shepherd cannot answer"

    def __init__(self, detail: str = "", retry_after: float | None = None) -> None:
        super().__init__(detail or self.title)
        self.detail = detail or self.title
        self.retry_after = retry_after


class InvalidApiKey(ShepherdError):
    """The API key is unknown, revoked or expired."""

    code, status, title = "invalid_api_key", 401, "The API key is not valid"


class UnknownSession(ShepherdError):
    """The session key is unknown, closed or revoked."""

    code, status, title = "unknown_session", 401, "The session is not known; log in again"


class Forbidden(ShepherdError):
    """The key is valid, but may not do this."""

    code, status, title = "forbidden", 403, "The key may not do this"


class NotFound(ShepherdError):
    """There is nothing at this address."""

    code, status, title = "not_found", 404, "There is nothing here"


class MethodNotAllowed(ShepherdError):
    """The address does not take this method."""

    code, status, title = "method_not_allowed", 405, "This address does not take this method"


class RequestTooLarge(ShepherdError):
    """The body is larger than SHEPHERD_MAX_BODY_BYTES."""

    code, status, title = "request_too_large", 413, "The request is too large"


class InvalidObservation(ShepherdError):
    """The observation is not in the agent's observation space."""

    code, status, title = "invalid_observation", 422, "The observation does not fit the agent's observation space"


class InvalidReward(ShepherdError):
    """The reward is no finite number."""

    code, status, title = "invalid_reward", 422, "The reward must be a finite number"


class InvalidRequest(ShepherdError):
    """The request is not of the form that this endpoint takes."""

    code, status, title = "invalid_request", 422, "The request is not of the right form"


class StepPending(ShepherdError):
    """A step of this session is still being answered."""

    code, status, title = "step_pending", 409, "A step of this session is still pending; wait for its answer"


class SequenceGap(ShepherdError):
    """`seq` is neither the next number nor the last answered one."""

    code, status, title = "sequence_gap", 409, "The sequence number is not the next one"


class QuotaExceeded(ShepherdError):
    """The agent has used its share of the CPU."""

    code, status, title = "quota_exceeded", 429, "The agent has used its share of the CPU; wait"


class Throttled(ShepherdError):
    """Too many requests."""

    code, status, title = "throttled", 429, "Too many requests; wait"


class NoCapacity(ShepherdError):
    """No execution is free and no more may be started."""

    code, status, title = "no_capacity", 503, "No execution is free; repeat the step later"


class ExecutionLost(ShepherdError):
    """The execution ended before it answered."""

    code, status, title = "execution_lost", 503, "The execution was lost; repeat the step"


class Unavailable(ShepherdError):
    """The database or the executions cannot be reached now."""

    code, status, title = "unavailable", 503, "Shepherd cannot serve now; repeat the request later"


class InternalError(ShepherdError):
    """A fault of Shepherd itself; its traceback is in the log, never in the reply."""

    code, status, title = "internal_error", 500, "Shepherd made an error"


BY_CODE: dict[str, type[ShepherdError]] = {cls.code: cls for cls in ShepherdError.__subclasses__()}


def from_code(code: str, detail: str, retry_after: float | None) -> ShepherdError:
    """The error that an execution sent by its code."""
    return BY_CODE.get(code, ShepherdError)(detail, retry_after)
