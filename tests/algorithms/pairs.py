"""An advised policy beside the stock one with the same weights."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th

from agents_app.algorithms.advice import neutral_advice, with_advice
from agents_app.algorithms.policies import policy_name
from agents_app.algorithms.registry import get_row
from agents_app.algorithms.spec import AgentSpec
from tests.algorithms.building import built, some, stack
from tests.algorithms.specs import CONTINUOUS, DISCRETE, OBSERVATIONS, make_spec

KINDS = pytest.mark.parametrize("kind", OBSERVATIONS)
ACTIONS = pytest.mark.parametrize(
    ("actions", "parameters"),
    [(DISCRETE, {}), (CONTINUOUS, {}), (CONTINUOUS, {"use_sde": True})],
    ids=["discrete", "continuous", "gSDE"],
)
METHODS: dict[str, dict[str, Any]] = {
    "intersection": {},
    "sampling": {"continuous_advice": "sampling"},
    "geometric": {"advice_method": "geometric", "advice_weight": 3 / 7},
    "union": {"advice_method": "union"},
    "reuse": {"advice_method": "reuse", "psi": 0.7},
    "shaping": {"advice_method": "shaping"},
}
# Each combination of methods and actions that means something of its own.
FITTING = [
    *((DISCRETE, {}, METHODS[name]) for name in METHODS if name != "sampling"),
    *((CONTINUOUS, sde, METHODS[name]) for name in METHODS if name != "union" for sde in ({}, {"use_sde": True})),
]
CORRECTION = pytest.mark.parametrize("correction", [True, False], ids=["correction", "no correction"])


class Pair:
    """An advised policy, the stock one with the same weights, and observations for both."""

    def __init__(
        self, kind: str, actions: Any, parameters: dict[str, Any], correction: bool, algorithm: str, **advice: Any
    ) -> None:
        facts: dict[str, Any] = {"advice_method": "intersection", "learning_correction": correction} | advice
        self.spec: AgentSpec = make_spec(algorithm, actions, OBSERVATIONS[kind], parameters, **facts)
        self.advised = built(self.spec).policy
        plain = make_spec(algorithm, actions, OBSERVATIONS[kind], parameters)
        self.stock = self._stock_policy(algorithm, plain)
        self.stock.load_state_dict(self.advised.state_dict())
        self.observations = some(plain.observations())
        self.batch = stack(self.observations)
        self.actions = th.tensor(np.stack(some(plain.actions())))

    @staticmethod
    def _stock_policy(algorithm: str, spec: AgentSpec) -> Any:
        row = get_row(algorithm)
        stock, name = row.load(), policy_name(row, spec.observations())
        env: gym.Env = gym.Env()
        env.observation_space, env.action_space = spec.observations(), spec.actions()
        use_sde = bool(spec.parameters.get("use_sde"))
        sizes = {"n_steps": 64} | ({} if algorithm == "A2C" else {"batch_size": 16})
        return stock(name, env, policy_kwargs={"net_arch": [8]}, use_sde=use_sde, device="cpu", **sizes).policy

    def with_advice(self, advice: np.ndarray) -> Any:
        """The batch with the same advice everywhere."""
        return stack([with_advice(obs, advice) for obs in self.observations])

    def neutral(self) -> Any:
        """The batch with neutral advice."""
        return self.with_advice(neutral_advice(self.spec.actions()))


def same(one: Any, other: Any) -> bool:
    """Whether two tensors are equal to the bit."""
    return th.equal(one, other)


OWN_MEAN, OWN_STD = th.tensor([0.5, -0.5]), th.tensor([0.8, 1.2])
SAID = np.array([1.5, 0.5, 0.6, 0.9], np.float32)


def fixed_gaussian(**advice: Any) -> tuple[Any, Any]:
    """A policy of one mind, whatever it sees, and a batch with advice for it."""
    pair = Pair("vector", CONTINUOUS, {}, advice.pop("learning_correction", True), "PPO", **advice)
    with th.no_grad():
        pair.advised.action_net.weight.zero_()
        pair.advised.action_net.bias[:] = OWN_MEAN
        pair.advised.log_std[:] = OWN_STD.log()
    return pair.advised, stack([with_advice(pair.observations[0], SAID)] * 20_000)
