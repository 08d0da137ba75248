"""What advice adds to a decision, by algorithm: a peer's advice is evaluated, and the action is drawn from the mixture. CPU time
in this process, without a server, in turns so that a busy machine is busy for both.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import torch as th

from agents_app.algorithms.actor import Actor, advice_weights
from agents_app.algorithms.advice import with_advice
from agents_app.algorithms.builder import build, family_of, seen_space
from agents_app.algorithms.spec import AgentSpec
from benchmarks.report import Line, Result
from benchmarks.rig import OBSERVATIONS
from envs_app.execution.advisors import Advisors

BAR = 300.0  # microseconds
CALLS, TURNS = 300, 7
NOISY: dict[str, Any] = {"action_noise": "normal 0.1"}
COMMON: dict[str, Any] = {"action_space": [[2], -1, 1], "observation_space": [[8], -10, 10]}
SETTINGS: dict[str, dict[str, Any]] = {
    "PPO": {"algorithm": "PPO", "action_space": 4},
    "DQN": {"algorithm": "DQN", "action_space": 4},
    "QR-DQN": {"algorithm": "QR-DQN", "action_space": 4},
    "BDPI": {"algorithm": "BDPI", "action_space": 4},
    "SAC": {"algorithm": "SAC"},
    "SAC, sampling": {"algorithm": "SAC", "continuous_advice": "sampling"},
    "TQC": {"algorithm": "TQC"},
    "TD3": {"algorithm": "TD3", "parameters": NOISY},
    "TD3, sampling": {"algorithm": "TD3", "parameters": NOISY, "continuous_advice": "sampling"},
    "DDPG": {"algorithm": "DDPG", "parameters": NOISY},
}


class OnePeer:
    """The policy of one other execution."""

    def __init__(self, weights: np.ndarray) -> None:
        self._weights = weights

    def versions(self) -> dict[int, int]:
        """Published once."""
        return {1: 1}

    def mean_returns(self) -> dict[int, float]:
        """Nothing is known."""
        return {}

    def weights(self, number: int) -> np.ndarray:
        """Of the policy."""
        return self._weights


class Spaces(gym.Env[Any, Any]):
    """Only that."""

    def __init__(self, spec: AgentSpec) -> None:
        self.observation_space, self.action_space = seen_space(spec), spec.actions()


def run() -> Result:
    """The row."""
    th.set_num_threads(1)
    numbers = {name: measure(**setting) for name, setting in SETTINGS.items()}
    return Result("added", [line(name, **number) for name, number in numbers.items()], numbers)


def measure(**fields: Any) -> dict[str, float]:
    """Microseconds of a decision without advice, of one with it, and of a peer's advice: 8 numbers, default networks."""
    alone, _ = _actor(AgentSpec(**COMMON | fields))
    spec = AgentSpec(**COMMON | fields, advice_method="intersection")
    advised, algorithm = _actor(spec)
    advisors = Advisors(algorithm, OnePeer(advice_weights(algorithm.policy)), spec)
    pairs = [with_advice(obs, advisors.advise(obs)) for obs in OBSERVATIONS]
    calls = {
        "alone_us": (lambda obs: alone.decide(obs, None, None), OBSERVATIONS),
        "advised_us": (lambda obs: advised.decide(obs, None, None), pairs),
        "peer_us": (advisors.advise, OBSERVATIONS),
    }
    turns = [{name: microseconds(*call) for name, call in calls.items()} for _ in range(TURNS)]
    return {name: round(min(turn[name] for turn in turns), 1) for name in calls}


def _actor(spec: AgentSpec) -> tuple[Actor, Any]:
    algorithm = build(spec, Spaces(spec), seed=1)
    algorithm.learning_starts = 0  # past the warm-up
    return family_of(spec).make_actor(algorithm), algorithm


def microseconds(call: Callable[[Any], Any], observations: Any) -> float:
    """CPU time of one call."""
    started = time.process_time()
    for obs in observations[:CALLS]:
        call(obs)
    return 1e6 * (time.process_time() - started) / CALLS


def line(name: str, alone_us: float, advised_us: float, peer_us: float) -> Line:
    """As the table shows it."""
    added = advised_us - alone_us + peer_us
    text = f"{added / 1000:+.2f} ms (the peer {peer_us / 1000:.2f}; a decision {alone_us / 1000:.2f} without)"
    return Line(f"advice adds to a decision of {name}", text, "< 0.3 ms", added < BAR)
