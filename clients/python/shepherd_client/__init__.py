"""Connects an environment to Shepherd, reinforcement learning as a service.

    from shepherd_client import Client

    with Client("sk_...") as client:
        session = client.session()
        action = session.act(observation)
        session.observe(next_observation, reward)

For a Gymnasium environment, `run(env, "sk_...")` is the whole program.
"""

from shepherd_client.client import DEFAULT_URL, Client, Reply, Session
from shepherd_client.errors import (
    ConnectionLost,
    ExecutionLost,
    Forbidden,
    InternalError,
    InvalidApiKey,
    InvalidObservation,
    InvalidRequest,
    InvalidReward,
    MethodNotAllowed,
    NoCapacity,
    NotFound,
    QuotaExceeded,
    RequestTooLarge,
    SequenceGap,
    ShepherdError,
    StepPending,
    Throttled,
    TransientError,
    Unavailable,
    UnexpectedReply,
    UnknownSession,
)
from shepherd_client.spaces import spaces_of
from shepherd_client.training import run

__all__ = [
    "DEFAULT_URL",
    "Client",
    "ConnectionLost",
    "ExecutionLost",
    "Forbidden",
    "InternalError",
    "InvalidApiKey",
    "InvalidObservation",
    "InvalidRequest",
    "InvalidReward",
    "MethodNotAllowed",
    "NoCapacity",
    "NotFound",
    "QuotaExceeded",
    "Reply",
    "RequestTooLarge",
    "SequenceGap",
    "Session",
    "ShepherdError",
    "StepPending",
    "Throttled",
    "TransientError",
    "Unavailable",
    "UnexpectedReply",
    "UnknownSession",
    "run",
    "spaces_of",
]
