"""The space notation of the wire (DESIGN.md section 5) and its Gymnasium meaning. No Django, no torch.

An integer n is Discrete(n); `[shape, low, high]` is a Box, where bounds of exactly 0 and 255 as integers mean an image of
uint8 and everything else float32, and bounds may be lists; a dictionary of those is a Dict.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from gymnasium import spaces

MAX_ACTIONS = 100_000
MAX_NUMBERS = 4_000_000  # in one observation


def parse_space(spec: Any) -> spaces.Space:
    """The Gymnasium space of a specification. Raises ValueError with a sentence that says what to write."""
    if isinstance(spec, bool):
        raise ValueError(f"{spec} is no space: write a number of choices, [shape, low, high] or a dictionary.")
    if isinstance(spec, int):
        return _discrete(spec)
    if isinstance(spec, list):
        return _box(spec)
    if isinstance(spec, dict):
        return _dictionary(spec)
    raise ValueError(f"{spec!r} is no space: write a number of choices, [shape, low, high] or a dictionary.")


def is_image(space: spaces.Space) -> bool:
    """Whether it is a Box of uint8 with height, width and channels."""
    return isinstance(space, spaces.Box) and space.dtype == np.uint8 and len(space.shape) == 3


def _discrete(n: int) -> spaces.Discrete:
    if not 1 <= n <= MAX_ACTIONS:
        raise ValueError(f"{n} is no number of choices: write a whole number from 1 to {MAX_ACTIONS}.")
    return spaces.Discrete(n)


def _box(spec: list[Any]) -> spaces.Box:
    if len(spec) != 3:
        raise ValueError(f"A list has three parts, [shape, low, high], e.g. [[8], -10, 10]; this one has {len(spec)}.")
    shape = _shape(spec[0])
    image = all(type(bound) is int for bound in spec[1:]) and spec[1:] == [0, 255]
    if image:
        return spaces.Box(0, 255, shape, np.uint8)
    low, high = _bound(spec[1], shape, "low"), _bound(spec[2], shape, "high")
    if not (low < high).all():
        raise ValueError("Every low bound must be less than its high bound.")
    return spaces.Box(low, high, shape, np.float32)


def _shape(spec: Any) -> tuple[int, ...]:
    if not isinstance(spec, list) or not spec or not all(type(n) is int and n > 0 for n in spec):
        raise ValueError(f"The shape is a list of positive whole numbers, e.g. [8] or [84, 84, 3]; not {spec!r}.")
    if math.prod(spec) > MAX_NUMBERS:
        raise ValueError(f"The shape {spec} has {math.prod(spec)} numbers; at most {MAX_NUMBERS} are taken.")
    return tuple(spec)


def _bound(value: Any, shape: tuple[int, ...], name: str) -> np.ndarray:
    try:
        bound = np.broadcast_to(np.asarray(value, dtype=np.float32), shape)
    except (TypeError, ValueError):
        raise ValueError(f"The {name} bound is a number or a list of the shape {list(shape)}; not {value!r}.") from None
    if np.isnan(bound).any():
        raise ValueError(f"The {name} bound has a NaN.")
    return bound.copy()


def _dictionary(spec: dict[str, Any]) -> spaces.Dict:
    if not spec:
        raise ValueError("A dictionary of spaces needs at least one key.")
    for key in ("advice", "action_mask", "_observation"):  # they ride in observations (algorithms/riders.py)
        if key in spec:
            raise ValueError(f"The key {key!r} is Shepherd's own: choose another one.")
    if any(isinstance(sub, dict) for sub in spec.values()):
        raise ValueError("A dictionary within a dictionary is no space: give every sensor a key of its own.")
    return spaces.Dict({key: parse_space(sub) for key, sub in spec.items()})
