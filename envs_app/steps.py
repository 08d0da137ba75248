"""One step as the layers hand it on: what a client says, and what it hears."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

Action = int | list[Any]


@dataclass(slots=True)
class Step:
    """What the client says. `obs` is as JSON gave it; the session checks it against the agent's space."""

    obs: Any
    reward: float = 0.0
    terminated: bool = False
    truncated: bool = False
    info: dict[str, Any] | None = None
    seq: int | None = None  # None: the original protocol, where every request is a new step
    advice: Any = None  # from a person or a heuristic at the client
    action_mask: list[bool] | None = None  # which actions are allowed here


@dataclass(slots=True)
class Reply:
    """What the client hears: an action, or at an episode's end none and the sum of its rewards."""

    action: Action | None
    seq: int
    episode_return: float | None = None
