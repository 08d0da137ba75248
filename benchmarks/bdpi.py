"""BDPI's critics as one batched ensemble beside one network after the other (tests/algorithms/bdpi_loop.py): the time of what is
learned at each step of the environment, in CPU seconds, in turns so that a busy machine is busy for both.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import torch as th
from gymnasium import spaces
from stable_baselines3.common.logger import configure

from agents_app.algorithms.bdpi import BDPI
from benchmarks.report import Line, Result
from tests.algorithms.bdpi_loop import LoopBDPI

FIVE_ROOMS, LUNAR_LANDER = spaces.Discrete(812), spaces.Box(-1, 1, (8,), np.float32)
OTHER = {"n_critics": 16, "fit_steps": 20, "policy_kwargs": {"net_arch": [32]}}
SETTINGS: dict[str, tuple[spaces.Space, dict[str, Any]]] = {
    "thesis 5.3.2, 812 states: 8 critics of 256, 10 gradient steps": (FIVE_ROOMS, {}),
    "Lunar Lander's known one: 16 critics of 32, 20 gradient steps": (LUNAR_LANDER, OTHER),
    "8 critics of 256 on 8 numbers, where arithmetic outweighs overhead": (LUNAR_LANDER, {}),
}
BAR, TURNS = 5.0, 4


class Noise(gym.Env[Any, Any]):
    """4 actions; nothing to learn."""

    def __init__(self, observation_space: spaces.Space) -> None:
        self.observation_space, self.action_space = observation_space, spaces.Discrete(4)

    def reset(self, **kwargs: Any) -> tuple[Any, dict[str, Any]]:
        """Anywhere."""
        return self.observation_space.sample(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Anywhere else."""
        return self.observation_space.sample(), float(np.random.standard_normal()), False, False, {}


def run() -> Result:
    """The row."""
    th.set_num_threads(1)
    numbers = {name: measure(*setting) for name, setting in SETTINGS.items()}
    return Result("bdpi", [line(name, **number) for name, number in numbers.items()], numbers)


def measure(space: spaces.Space, parameters: dict[str, Any]) -> dict[str, float]:
    """Milliseconds of one step's learning, and how far the results are apart after all of them."""
    model = BDPI("MlpPolicy", Noise(space), seed=1, device="cpu", learning_starts=1000, **parameters).learn(500)
    model.set_logger(configure(None, []))
    loop = LoopBDPI(model)
    ours, theirs = [], []
    for _ in range(TURNS):
        batches = model.draw_batches(model.batch_size)
        ours.append(seconds(lambda b=batches: model.train_epoch(b)))  # type: ignore[misc]
        theirs.append(seconds(lambda b=batches: loop.train(b)))  # type: ignore[misc]
    return {"ensemble_ms": 1000 * min(ours), "loop_ms": 1000 * min(theirs), "apart": distance(model, loop)}


def seconds(work: Callable[[], Any]) -> float:
    """CPU seconds of one call."""
    started = time.process_time()
    work()
    return time.process_time() - started


@th.no_grad()
def distance(model: BDPI, loop: LoopBDPI) -> float:
    """The largest difference between the two actors' probabilities of an action."""
    inputs = model.draw_batches(200).inputs.flatten(0, 1)
    theirs = loop.actor(loop._vectors(inputs)).softmax(-1)
    return float((model.actor(inputs[None])[0].softmax(-1) - theirs).abs().max())


def line(name: str, ensemble_ms: float, loop_ms: float, apart: float) -> Line:
    """As the table shows it."""
    factor = loop_ms / ensemble_ms
    text = f"{factor:.1f} times as fast ({ensemble_ms:.0f} against {loop_ms:.0f} ms; probabilities {apart:.0e} apart)"
    return Line(name, text, f"{BAR:.0f} times", factor >= BAR)
