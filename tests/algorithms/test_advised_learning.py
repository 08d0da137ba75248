"""Advised algorithms on the policy learn from advice of every kind."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from agents_app.algorithms.advice import advised_space, neutral_advice, with_advice
from agents_app.algorithms.builder import build
from agents_app.algorithms.spec import AgentSpec
from agents_app.algorithms.weights import flatten
from tests.algorithms.pairs import CORRECTION, FITTING
from tests.algorithms.specs import DISCRETE, OBSERVATIONS, make_spec


@pytest.mark.parametrize(("actions", "parameters", "advice"), FITTING, ids=str)
@pytest.mark.parametrize("algorithm", ["PPO", "A2C", "TRPO"])
@CORRECTION
def test_it_learns_from_advised_steps(
    algorithm: str, actions: Any, parameters: dict[str, Any], advice: dict[str, Any], correction: bool
) -> None:
    """Of each game, some updates: the weights move and stay finite, whether the advice is an order, soft or none."""
    facts = {"advice_method": "intersection", "learning_correction": correction} | advice
    spec = make_spec(algorithm, actions, OBSERVATIONS["vector"], parameters, **facts)
    algorithm_, before = build(spec, Counsel(spec), 1), None
    for _ in range(2):
        algorithm_.learn(64, reset_num_timesteps=False)
        after = flatten(algorithm_.policy)
        assert np.isfinite(after).all()
        assert before is None or not np.array_equal(before, after)
        before = after


class Counsel(gym.Env):
    """Random states with advice of every kind in turn; a small action is a good one. Ends after 10 steps."""

    def __init__(self, spec: AgentSpec) -> None:
        self.inner, self.action_space = spec.observations(), spec.actions()
        self.observation_space = advised_space(self.inner, self.action_space)
        hard, soft = (
            ([0, 1, 0], [0.2, 0.2, 0.6]) if spec.action_space == DISCRETE else ([9, 9, 0, 0], [1, -1, 2, np.inf])
        )
        neutral = neutral_advice(self.action_space)
        self.kinds = [np.array(hard, np.float32), np.array(soft, np.float32), neutral]
        self.steps = 0
        self.inner.seed(1)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Begin anew."""
        return self._see(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Any action."""
        self.steps += 1
        return self._see(), -float(np.sum(np.square(action))), self.steps % 10 == 0, False, {}

    def _see(self) -> dict[str, Any]:
        return with_advice(self.inner.sample(), self.kinds[self.steps % 3])
