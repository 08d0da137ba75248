"""Agents of every kind with small networks and buffers, for tests."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from agents_app.algorithms.policies import CNN, DICTIONARY, kind_of_policy
from agents_app.algorithms.registry import ROWS, Row, get_row
from agents_app.algorithms.spec import AgentSpec

DISCRETE, CONTINUOUS = 3, [[2], -2, 2]
IMAGE = [[36, 36, 3], 0, 255]
OBSERVATIONS: dict[str, Any] = {
    "discrete": 5,
    "vector": [[3], -1, 1],
    "image": IMAGE,
    "dict": {"camera": IMAGE, "speed": [[2], -1, 1], "room": 4},
}

_NET = {"net_arch": "8"}
_ON_POLICY = _NET | {"n_steps": 32}
_PPO = _ON_POLICY | {"batch_size": 16, "n_epochs": 2}
_OFF_POLICY = _NET | {"learning_starts": 16, "batch_size": 8, "buffer_size": 200}
_OWN: dict[str, dict[str, Any]] = {
    "PPO": _PPO,
    "RecurrentPPO": _PPO,
    "MaskablePPO": _PPO,
    "A2C": _NET | {"n_steps": 8},
    "TRPO": _ON_POLICY | {"batch_size": 16},
    "ARS": {"n_delta": 1},
    "BDPI": _OFF_POLICY | {"n_critics": 2, "q_loops": 2, "fit_steps": 2},
    "PolicyGradient": _ON_POLICY,
}


def small(algorithm: str) -> dict[str, Any]:
    """Parameters with which the algorithm updates a few times within a hundred steps, and quickly."""
    parameters = dict(_OWN.get(algorithm, _OFF_POLICY))
    if algorithm not in ("DQN", "QR-DQN") and get_row(algorithm).family == "off_policy":
        parameters |= {"train_freq": 4}
    return parameters


def make_spec(
    algorithm: str = "PPO",
    actions: Any = DISCRETE,
    observations: Any = OBSERVATIONS["vector"],
    parameters: dict[str, Any] | None = None,
    **fields: Any,
) -> AgentSpec:
    """An agent with small parameters, and others where told."""
    return AgentSpec(algorithm, actions, observations, parameters=small(algorithm) | (parameters or {}), **fields)


def actions_of(row: Row) -> list[Any]:
    """The kinds of actions that the algorithm can choose."""
    return [DISCRETE] * row.discrete + [CONTINUOUS] * row.continuous


def observations_of(row: Row) -> list[str]:
    """The kinds of observations that the algorithm can look at."""
    kinds = {kind_of_policy(name) for name in row.policies}
    return ["discrete", "vector"] + ["image"] * (CNN in kinds) + ["dict"] * (DICTIONARY in kinds)


def every_kind() -> Iterator[tuple[str, Any, str]]:
    """Every algorithm with every kind of observation; its kinds of actions take turns."""
    for row in ROWS:
        actions = actions_of(row)
        for index, kind in enumerate(observations_of(row)):
            yield row.name, actions[index % len(actions)], kind
