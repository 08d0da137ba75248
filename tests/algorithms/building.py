"""Algorithms built as executions build them, on a tape, for tests."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import torch as th
from gymnasium import spaces
from stable_baselines3.common.utils import obs_as_tensor

import envs_app.shepherd_env  # noqa: F401  (registers ShepherdEnv-v0)
from agents_app.algorithms.builder import build, family_of, seen_space
from agents_app.algorithms.spec import AgentSpec


def environment(spec: AgentSpec) -> gym.Env:
    """The environment that the algorithm plays on."""
    feed = family_of(spec).make_feed()
    return gym.make("ShepherdEnv-v0", observation_space=seen_space(spec), action_space=spec.actions(), feed=feed)


def built(spec: AgentSpec, seed: int | None = 1) -> Any:
    """The algorithm, with random weights also where they begin at zero."""
    algorithm = build(spec, environment(spec), seed)
    generator = th.Generator().manual_seed(0)
    with th.no_grad():
        for parameter in algorithm.policy.parameters():
            parameter += 0.05 * th.randn(parameter.shape, generator=generator)
    return algorithm


def some(space: spaces.Space, count: int = 4) -> list[Any]:
    """Observations, always the same ones."""
    space.seed(7)
    return [space.sample() for _ in range(count)]


def stack(observations: list[Any]) -> Any:
    """Observations as a batch of tensors."""
    if isinstance(observations[0], dict):
        return obs_as_tensor(
            {key: np.stack([o[key] for o in observations]) for key in observations[0]}, th.device("cpu")
        )
    return obs_as_tensor(np.stack(observations), th.device("cpu"))


def tensors(parameters: Any) -> list[th.Tensor]:
    """All tensors in nested dictionaries and lists: weights, and what the optimisers know."""
    if isinstance(parameters, th.Tensor):
        return [parameters]
    if isinstance(parameters, dict):
        parameters = list(parameters.values())
    return [tensor for part in parameters for tensor in tensors(part)] if isinstance(parameters, list) else []
