"""Every algorithm of the catalogue, built as executions build it, learns in a second or two: to say what it sees.

Seen to hold with the seeds 0 and 1; QR-DQN and CrossQ, which vary most, and all that are advised, with 0 to 2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch as th
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from agents_app.algorithms.builder import build
from agents_app.algorithms.registry import ROWS, get_row
from agents_app.algorithms.spec import AgentSpec
from tests.algorithms.games import Advised, Identity, Point, mean_return

NET: dict[str, Any] = {"net_arch": "32", "gamma": 0.0}
QUICK = NET | {"learning_rate": 0.01}
PPO = QUICK | {"n_steps": 64, "batch_size": 32, "n_epochs": 5}
TRPO = QUICK | {"n_steps": 64, "batch_size": 64}
OFF_POLICY = QUICK | {"learning_starts": 100, "batch_size": 32, "buffer_size": 2000}
VALUES = OFF_POLICY | {"target_update_interval": 50, "train_freq": 2, "total_timesteps": 800}
ACTIONS = OFF_POLICY | {"train_freq": 2, "gradient_steps": 1}
NOISE = {"action_noise": "normal 0.2"}
BDPI = NET | {"learning_rate": 0.01, "learning_starts": 64, "batch_size": 32, "train_freq": 4}
BDPI |= {"n_critics": 4, "q_loops": 2, "delta": 0.2, "alpha": 0.5}
ARS = {"n_delta": 8, "delta_std": 0.3, "learning_rate": 0.2}
PAIRS: dict[tuple[str, str], tuple[dict[str, Any], int]] = {  # parameters, and steps to learn in
    ("PPO", "choice"): (PPO, 640),
    ("A2C", "choice"): (QUICK | {"n_steps": 16}, 2000),
    ("DQN", "choice"): (VALUES, 800),
    ("QR-DQN", "choice"): (VALUES | {"batch_size": 8, "train_freq": 4}, 800),
    ("TRPO", "choice"): (TRPO, 1000),
    ("ARS", "choice"): (ARS, 3000),
    ("RecurrentPPO", "choice"): (PPO | {"n_epochs": 3}, 512),
    ("MaskablePPO", "choice"): (PPO, 640),
    ("BDPI", "choice"): (BDPI, 400),
    ("PolicyGradient", "choice"): (NET | {"learning_rate": 0.02, "baseline_steps": 2}, 1500),
    ("PPO", "number"): (PPO, 1280),
    ("A2C", "number"): (QUICK | {"n_steps": 16}, 3000),
    ("TRPO", "number"): (TRPO, 1500),
    ("RecurrentPPO", "number"): (PPO | {"n_epochs": 3}, 1280),
    ("PolicyGradient", "number"): (NET | {"learning_rate": 0.01, "n_episodes": 4, "normalize_advantage": True}, 3000),
    ("DDPG", "number"): (ACTIONS | NOISE, 700),
    ("TD3", "number"): (ACTIONS | NOISE, 700),
    ("SAC", "number"): (ACTIONS, 600),
    ("TQC", "number"): (ACTIONS, 600),
    ("CrossQ", "number"): (ACTIONS | {"policy_delay": 1}, 800),
    ("ARS", "number"): (ARS, 3000),
}
BARS = {"choice": 9.0, "number": -1.0}  # the best are 10 and 0; at random 3.3, and doing nothing -3.3


class Free(Identity):
    """Everything is allowed, for MaskablePPO."""

    def action_masks(self) -> np.ndarray:
        """All."""
        return np.ones(3, bool)


class Mixed:
    """On the policy, `predict` is what the learner would do alone: this is what it does with the advice."""

    def __init__(self, model: OnPolicyAlgorithm) -> None:
        self.policy = model.policy

    def predict(self, obs: Any, deterministic: bool) -> tuple[Any, None]:
        """The most probable action."""
        batch: Any = {key: th.as_tensor(np.asarray(value))[None] for key, value in obs.items()}
        action = self.policy.get_distribution(batch).get_actions(deterministic).detach().numpy()[0]
        return (action if action.ndim == 0 else action.clip(-1, 1)), None


ADVISED = [(name, kind) for name, kind in PAIRS if get_row(name).advice]
WRONG = {"choice": [0.8, 0.1, 0.1], "number": [0.9, 0.3]}  # the same action at each state, or its mean and deviation


def learned(name: str, kind: str, seed: int, advised: bool = False) -> float:
    """The mean return after learning; `advised`: wrongly, while it learns and afterwards."""
    parameters, steps = PAIRS[name, kind]
    space: Any = 3 if kind == "choice" else [[1], -1, 1]
    env: Any = Free() if kind == "choice" else Point()
    if advised:
        env = Advised(env, np.array(WRONG[kind], np.float32))
    spec = AgentSpec(name, space, space, parameters=parameters, advice_method="intersection" if advised else "none")
    model = build(spec, env, seed).learn(steps)
    env.reset(seed=100 + seed)
    return mean_return(Mixed(model) if advised and isinstance(model, OnPolicyAlgorithm) else model, env)


@pytest.mark.parametrize(("name", "kind"), PAIRS)
def test_it_learns(name: str, kind: str) -> None:
    assert learned(name, kind, seed=1) > BARS[kind]


@pytest.mark.parametrize(("name", "kind"), ADVISED)
def test_it_learns_in_spite_of_wrong_advice(name: str, kind: str) -> None:
    assert learned(name, kind, seed=1, advised=True) > BARS[kind]


def test_every_algorithm_is_here_with_each_kind_of_actions() -> None:
    kinds = {(row.name, "choice") for row in ROWS if row.discrete} | {
        (row.name, "number") for row in ROWS if row.continuous
    }
    assert set(PAIRS) == kinds
