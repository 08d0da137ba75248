"""The baselines: Stable-Baselines3 alone in a process, which stalls its environment at each update; the original Shepherd."""

from __future__ import annotations

import time
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.report import Line, Result
from benchmarks.rig import EPISODE, OBSERVATIONS, ROLLOUT

UPDATES = 5
ORIGINAL = {
    "the original Shepherd, 1 client (quoted, issue 2)": "340 to 610 steps/s, p50 1 to 2 ms; with keep-alive 22/s, 44 ms",
    "its stalls at each update (quoted)": "0.65 to 1.5 s",
    "its 16 clients (quoted)": "150 to 370 steps/s, p50 40 to 60 ms, or a deadlock",
    "its first action of a session (quoted)": "1 to 13 s",
    "its memory per execution (quoted)": "130 MB or more",
}


class Clock(gym.Env):
    """What the clients of the other rows play, as an environment that notes when it is stepped."""

    observation_space = gym.spaces.Box(-10, 10, (8,), np.float32)
    action_space = gym.spaces.Discrete(4)

    def __init__(self) -> None:
        self.times: list[float] = []

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[np.ndarray, dict[str, Any]]:
        """An episode of 200 steps."""
        return OBSERVATIONS[0], {}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """The next observation."""
        self.times.append(time.perf_counter())
        number = len(self.times)
        return OBSERVATIONS[number % len(OBSERVATIONS)], 1.0, number % EPISODE == 0, False, {}


def run() -> Result:
    """The row."""
    import torch as th
    from stable_baselines3 import PPO

    th.set_num_threads(1)  # as in an execution
    clock = Clock()
    PPO("MlpPolicy", clock, device="cpu").learn(UPDATES * ROLLOUT + 1)
    gaps = np.diff(clock.times)
    between, stalls = gaps[gaps < 0.1], np.sort(gaps)[-UPDATES:]
    numbers = {"rate": 1 / gaps.mean(), "rate_between_updates": 1 / between.mean(), "stall_s": float(np.median(stalls))}
    text = f"{numbers['rate']:.0f}/s, {numbers['rate_between_updates']:.0f}/s between updates"
    lines = [
        Line("SB3's PPO in process, the same environment", text),
        Line(
            "its environment stands still at each update",
            f"median {numbers['stall_s']:.2f} s, longest {stalls[-1]:.2f} s",
        ),
        *(Line(what, quoted) for what, quoted in ORIGINAL.items()),
    ]
    return Result("inprocess", lines, {name: round(value, 3) for name, value in numbers.items()})
