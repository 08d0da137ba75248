"""Every algorithm of the catalogue, built as executions build it, learns in a second or two: to say what it sees.

Seen to hold with the seeds 0 and 1; QR-DQN and CrossQ, which vary most, with 0 to 2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from agents_app.algorithms.builder import build
from agents_app.algorithms.registry import ROWS
from agents_app.algorithms.spec import AgentSpec
from tests.algorithms.games import Identity, Point, mean_return

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


def learned(name: str, kind: str, seed: int) -> float:
    """The mean return after learning."""
    parameters, steps = PAIRS[name, kind]
    space: Any = 3 if kind == "choice" else [[1], -1, 1]
    env = Free() if kind == "choice" else Point()
    model = build(AgentSpec(name, space, space, parameters=parameters), env, seed).learn(steps)
    env.reset(seed=100 + seed)
    return mean_return(model, env)


@pytest.mark.parametrize(("name", "kind"), PAIRS)
def test_it_learns(name: str, kind: str) -> None:
    assert learned(name, kind, seed=1) > BARS[kind]


def test_every_algorithm_is_here() -> None:
    assert {name for name, _ in PAIRS} == {row.name for row in ROWS}
