"""What JSON gave, as the agent's spaces want it: observations, rewards and masks in, actions out. No Django, no torch.

Everything is checked at the door, since an algorithm that meets a wrong shape or a NaN dies of it. The check of a
vector of 8 floats takes a few microseconds; the words of a refusal are sought only when something is refused.
"""

from __future__ import annotations

from array import array
from itertools import chain
from typing import Any

import numpy as np
from gymnasium import Space, spaces

from envs_app.errors import InvalidObservation, InvalidRequest, InvalidReward

Observation = int | np.ndarray | dict[str, Any]

NUMBERS = {int, float}
LARGEST = float(np.finfo(np.float32).max)  # networks compute in float32; past it is infinity


def read_observation(space: Space, value: Any, name: str = "obs") -> Observation:
    """The observation `value`, as JSON gave it, of the type and shape of `space`. Raises InvalidObservation."""
    if isinstance(space, spaces.Box):
        return _read_box(space, value, name)
    if isinstance(space, spaces.Discrete):
        return _read_discrete(space, value, name)
    if isinstance(space, spaces.Dict):
        return _read_dict(space, value, name)
    raise InvalidObservation(f"Observations of the space {space} cannot be read.")


def read_reward(value: Any) -> float:
    """The reward as a float that is still finite in float32. Raises InvalidReward."""
    if type(value) not in NUMBERS:
        raise InvalidReward(f"reward is {_shown(value)}; a finite number is expected.")
    if not -LARGEST <= value <= LARGEST:  # false for NaN too
        raise InvalidReward(f"reward is {_shown(value)}; a finite number is expected, at most {LARGEST:.2g}.")
    return float(value)


def read_mask(value: Any, n: int) -> np.ndarray:
    """The mask of `n` actions, (n,) of bool: which ones are allowed here, at least one. Raises InvalidRequest."""
    if type(value) is not list or len(value) != n:
        raise InvalidRequest(
            f"action_mask is {_shown(value)}; a list of {n} is expected: true or false for each action."
        )
    for index, allowed in enumerate(value):
        if allowed is not True and allowed is not False:
            raise InvalidRequest(f"action_mask[{index}] is {_shown(allowed)}; true or false is expected.")
    if True not in value:
        raise InvalidRequest("action_mask allows no action; at least one must be true.")
    return np.array(value, dtype=np.bool_)


def read_advice(space: Space, value: Any) -> np.ndarray:
    """What a client advises to do: (A,) probabilities, or (2A,) means and standard deviations. Raises InvalidRequest."""
    if isinstance(space, spaces.Discrete):
        advice = _read_numbers(value, int(space.n), "advice", "a list of {n} is expected: how good each action is")
        if advice.min() < 0 or advice.sum() <= 0:
            raise InvalidRequest("advice has a negative number, or only zeros; how good each action is, is expected.")
        return advice / advice.sum()
    if type(value) is not dict or value.keys() != {"mean", "std"}:
        raise InvalidRequest('advice is an object for these actions: {"mean": [...], "std": [...]}.')
    count = int(np.prod(space.shape or ()))
    mean, std = (
        _read_numbers(value[key], count, f"advice.{key}", "a list of {n} is expected") for key in ("mean", "std")
    )
    if std.min() <= 0:
        raise InvalidRequest("advice.std has a number that is not above 0.")
    return np.concatenate([mean, std])


def _read_numbers(value: Any, n: int, name: str, expected: str) -> np.ndarray:
    try:
        return _read_box(spaces.Box(-np.inf, np.inf, (n,), np.float32), value, name)
    except InvalidObservation as error:
        raise InvalidRequest(f"{error.detail} For advice, {expected.format(n=n)}.") from None


def write_action(space: Space, action: Any) -> int | list[Any]:
    """The action of an algorithm, for JSON: an int for Discrete, nested lists of numbers for a Box.

    Raises ArithmeticError for NaN: the execution goes back to its last save.
    """
    action = np.asarray(action)
    if isinstance(space, spaces.Discrete):
        return int(action.item())
    if not np.isfinite(action).all():
        raise ArithmeticError("the action is no longer finite: try a smaller learning rate, or scale the rewards")
    return action.reshape(space.shape).tolist()


def _read_discrete(space: spaces.Discrete, value: Any, name: str) -> int:
    last = int(space.start + space.n) - 1
    integral = type(value) is int or (type(value) is float and value.is_integer())  # some languages know only floats
    if not integral or not space.start <= value <= last:
        raise InvalidObservation(f"{name} is {_shown(value)}; a whole number from {space.start} to {last} is expected.")
    return int(value)


def _read_dict(space: spaces.Dict, value: Any, name: str) -> dict[str, Any]:
    expected = f"the keys {', '.join(space.spaces)} is expected"
    if type(value) is not dict:
        raise InvalidObservation(f"{name} is {_shown(value)}; an object with {expected}.")
    if value.keys() != space.spaces.keys():
        missing, unknown = sorted(space.spaces.keys() - value.keys()), sorted(value.keys() - space.spaces.keys())
        wrong = [f"lacks {key!r}" for key in missing[:3]] + [f"has an unknown {key[:20]!r}" for key in unknown[:3]]
        raise InvalidObservation(f"{name} {' and '.join(wrong)}; an object with exactly {expected}.")
    return {key: read_observation(sub, value[key], f"{name}.{key}") for key, sub in space.spaces.items()}


def _read_box(space: spaces.Box, value: Any, name: str) -> np.ndarray:
    flat = _flatten(space.shape, value, name)
    image = space.dtype == np.uint8
    numbers = _bytes(flat) if image else _floats(flat)
    if numbers is None:
        raise InvalidObservation(_wrong_number(space.shape, flat, name, image))
    return numbers.reshape(space.shape)


def _flatten(shape: tuple[int, ...], value: Any, name: str) -> list[Any]:
    """The numbers of nested lists, which must have exactly `shape`."""
    rows = [value]
    for depth, length in enumerate(shape):
        for index, row in enumerate(rows):
            if type(row) is not list or len(row) != length:
                where = name + _position(shape[:depth], index)
                raise InvalidObservation(
                    f"{where} is {_shown(row)}; a list of {length} is expected, for the shape {list(shape)}."
                )
        rows = list(chain.from_iterable(rows)) if depth else value
    return rows


def _floats(flat: list[Any]) -> np.ndarray | None:
    """The numbers as float32; None if one is no number or not finite."""
    if not NUMBERS.issuperset(map(type, flat)):
        return None
    try:
        floats = np.frombuffer(array("f", flat), np.float32)  # unlike numpy's cast, it does not warn of infinities
    except OverflowError:  # an integer past the range of float
        return None
    return floats if np.isfinite(floats).all() else None


def _bytes(flat: list[Any]) -> np.ndarray | None:
    """The numbers as uint8; None if one is no integer from 0 to 255."""
    if not {int}.issuperset(map(type, flat)):
        return None
    try:
        return np.frombuffer(bytearray(flat), np.uint8)
    except ValueError:
        return None


def _wrong_number(shape: tuple[int, ...], flat: list[Any], name: str, image: bool) -> str:
    """The sentence about the first of `flat` that is no number of this kind."""
    read = _bytes if image else _floats
    index = next(index for index, item in enumerate(flat) if read([item]) is None)
    expected = "a whole number from 0 to 255" if image else "a finite number"
    return f"{name}{_position(shape, index)} is {_shown(flat[index])}; {expected} is expected."


def _position(shape: tuple[int, ...], index: int) -> str:
    """The place of the flat `index` in nested lists of `shape`, like [3][0]."""
    return "".join(f"[{place}]" for place in np.unravel_index(index, shape)) if shape else ""


def _shown(value: Any) -> str:
    """A value in a few words, whatever it is: it may be huge, or nested a thousand deep."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, int) and abs(value) >= 10**20:
        return "a whole number of more than 20 digits"
    if isinstance(value, int | float):
        return str(value)
    if isinstance(value, str):
        return f"the text {value[:20]!r}"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    return "an object" if isinstance(value, dict) else f"a {type(value).__name__}"
