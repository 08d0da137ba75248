"""What can go wrong between a client and Shepherd.

ShepherdError
├── TransientError              the client has repeated the request until its patience ended
│   ├── ConnectionLost     -    is the server running, is the URL right? then repeat the step
│   ├── Unavailable        503  Shepherd, or what stands before it, cannot serve now; repeat the step
│   ├── StepPending        409  another program steps this session, or the first answer takes too long; repeat the step
│   ├── QuotaExceeded      429  the agent has used its share of the CPU; repeat the step later
│   ├── Throttled          429  too many requests; repeat the step later
│   ├── NoCapacity         503  no execution is free; repeat the step later
│   └── ExecutionLost      503  the execution ended; repeat the step
├── InvalidApiKey          401  use a valid API key
├── UnknownSession         401  log in again
├── Forbidden              403  use a key with the scope that is needed
├── NotFound               404  mend the URL
├── MethodNotAllowed       405  mend the URL
├── RequestTooLarge        413  send smaller observations
├── InvalidObservation     422  mend the observation; the session goes on
├── InvalidReward          422  mend the reward; the session goes on
├── InvalidRequest         422  mend the request; the session goes on
├── SequenceGap            409  another program has stepped this session; log in again, or resume with its `seq`
├── InternalError          500  report it to whoever runs the server; the session goes on
└── UnexpectedReply        -    this is not a Shepherd server; mend the URL
"""

from __future__ import annotations


class ShepherdError(Exception):
    """No action came. `code` is the server's stable name of the error, `detail` says what to do."""

    code = "error"

    def __init__(self, detail: str, *, code: str = "", status: int = 0, retry_after: float | None = None) -> None:
        super().__init__(detail)
        self.detail = detail
        self.code = code or self.code
        self.status = status  # of HTTP; 0 when no answer came
        self.retry_after = retry_after  # seconds


class TransientError(ShepherdError):
    """Repeating the same step may help; the client did so until its patience ended."""


class ConnectionLost(TransientError):
    """No answer came."""

    code = "connection_lost"


class Unavailable(TransientError):
    """Shepherd cannot serve now, or a proxy before it cannot reach it."""

    code = "unavailable"


class StepPending(TransientError):
    """A step of this session is still being answered."""

    code = "step_pending"


class QuotaExceeded(TransientError):
    """The agent has used its share of the CPU."""

    code = "quota_exceeded"


class Throttled(TransientError):
    """Too many requests."""

    code = "throttled"


class NoCapacity(TransientError):
    """No execution is free and no more may be started."""

    code = "no_capacity"


class ExecutionLost(TransientError):
    """The execution ended before it answered."""

    code = "execution_lost"


class InvalidApiKey(ShepherdError):
    """The API key is unknown, revoked or expired."""

    code = "invalid_api_key"


class UnknownSession(ShepherdError):
    """The session is unknown or closed."""

    code = "unknown_session"


class Forbidden(ShepherdError):
    """The key is valid, but may not do this."""

    code = "forbidden"


class NotFound(ShepherdError):
    """There is nothing at this address."""

    code = "not_found"


class MethodNotAllowed(ShepherdError):
    """The address does not take this method."""

    code = "method_not_allowed"


class RequestTooLarge(ShepherdError):
    """The server takes no requests of this size."""

    code = "request_too_large"


class InvalidObservation(ShepherdError):
    """The observation is not in the agent's observation space."""

    code = "invalid_observation"


class InvalidReward(ShepherdError):
    """The reward is no finite number."""

    code = "invalid_reward"


class InvalidRequest(ShepherdError):
    """The request is not of the form that Shepherd takes."""

    code = "invalid_request"


class SequenceGap(ShepherdError):
    """`seq` is neither the next number nor that of the last answered step."""

    code = "sequence_gap"


class InternalError(ShepherdError):
    """The server made an error."""

    code = "internal_error"


class UnexpectedReply(ShepherdError):
    """The reply is not Shepherd's."""

    code = "unexpected_reply"


BY_CODE: dict[str, type[ShepherdError]] = {
    cls.code: cls
    for cls in [*ShepherdError.__subclasses__(), *TransientError.__subclasses__()]
    if cls is not TransientError
}
BY_STATUS: dict[int, type[ShepherdError]] = {429: Throttled, 502: Unavailable, 503: Unavailable, 504: Unavailable}
