"""Which Celery queue an agent's executions go to: those that need much memory and time go to the machines that have it."""

from __future__ import annotations

import math
from typing import Any

SMALL, LARGE = "small", "large"
QUEUES = (SMALL, LARGE)
LARGE_INPUT = 4096  # numbers of an observation: images, mostly
LARGE_LAYER = 512  # the widest hidden layer


def queue_of(agent: dict[str, Any]) -> str:
    """By the size of the network of an AgentSpec (as a dictionary): what it sees, and its widest layer."""
    widths = _numbers(agent["parameters"].get("net_arch"))
    if inputs(agent["observation_space"]) >= LARGE_INPUT or max(widths, default=0) >= LARGE_LAYER:
        return LARGE
    return SMALL


def inputs(space: Any) -> int:
    """Numbers that a network sees of an observation space (agents_app.spaces)."""
    if isinstance(space, dict):
        return sum(inputs(sub) for sub in space.values())
    return space if isinstance(space, int) else math.prod(space[0])


def _numbers(value: Any) -> list[int]:
    """All whole numbers in `net_arch`, however it is written: "64,64" or "pi=64 vf=128"."""
    digits = "".join(letter if letter.isdigit() else " " for letter in str(value or ""))
    return [int(word) for word in digits.split()]
