"""The learning histories that parity compares: which there are, how they are recorded, where they are kept."""

from __future__ import annotations

import json
import threading
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import gymnasium as gym

from benchmarks.report import RESULTS

FOLDER = RESULTS / "parity"
FIRST_EXECUTION = 7919  # what an execution adds to the agent's seed, times its number: the first one has the number 1

ALONE, PARALLEL = "in process", "in process with 4 environments"
HTTP, SHARED = "over HTTP", "4 clients"
ENVIRONMENTS = {ALONE: 1, PARALLEL: 4, HTTP: 1, SHARED: 4}


@dataclass(frozen=True)
class Case:
    """An algorithm on an environment, learned in several ways; pairs of them are compared, the second with the first."""

    name: str
    algorithm: str
    environment: str
    steps: int
    seeds: int
    parameters: dict[str, Any] = field(default_factory=dict)
    pairs: tuple[tuple[str, str], ...] = ((ALONE, HTTP),)

    @property
    def ways(self) -> list[str]:
        """All that are compared."""
        return list(dict.fromkeys(way for pair in self.pairs for way in pair))


DQN = {  # rl-baselines3-zoo's for CartPole-v1
    "learning_rate": 2.3e-3,
    "batch_size": 64,
    "buffer_size": 100_000,
    "learning_starts": 1000,
    "gamma": 0.99,
    "target_update_interval": 10,
    "train_freq": 256,
    "gradient_steps": 128,
    "exploration_fraction": 0.16,
    "exploration_final_eps": 0.04,
    "net_arch": "256,256",
    "total_timesteps": 50_000,
}
SAC = {"learning_rate": 1e-3}  # rl-baselines3-zoo's for Pendulum-v1
CASES = (
    Case(
        "PPO on CartPole-v1", "PPO", "CartPole-v1", 50_000, 5, pairs=((ALONE, HTTP), (HTTP, SHARED), (PARALLEL, SHARED))
    ),
    Case("DQN on CartPole-v1", "DQN", "CartPole-v1", 50_000, 4, DQN),
    Case("SAC on Pendulum-v1", "SAC", "Pendulum-v1", 6_000, 4, SAC),
)


@dataclass
class History:
    """The episodes of one run: the step (of all clients together) at which each ended, and its return."""

    episodes: list[list[float]]
    seconds: float
    commit: str = ""  # of the code that it was made with


class Recorder(gym.Wrapper):
    """Notes each episode's end and return; several environments may share the count."""

    def __init__(self, env: gym.Env, log: Log) -> None:
        super().__init__(env)
        self.log, self.total = log, 0.0

    def reset(self, **kwargs: Any) -> tuple[Any, dict[str, Any]]:
        """As the environment."""
        self.total = 0.0
        return self.env.reset(**kwargs)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """As the environment."""
        obs, reward, terminated, truncated, info = self.env.step(action)
        self.total += float(reward)
        self.log.note(self.total if terminated or truncated else None)
        return obs, reward, terminated, truncated, info


class Log:
    """Steps and returns of all environments of a run."""

    def __init__(self) -> None:
        self.steps = 0
        self.episodes: list[list[float]] = []
        self._lock = threading.Lock()

    def note(self, total: float | None) -> None:
        """A step; with `total`, the end of an episode."""
        with self._lock:
            self.steps += 1
            if total is not None:
                self.episodes.append([self.steps, round(total, 2)])


def path_of(case: Case, way: str, seed: int) -> Path:
    """Where a history is kept."""
    return FOLDER / f"{case.name}, {way}, {seed}.json".replace(" ", "-").replace(",", "").lower()


def write(case: Case, way: str, seed: int, history: History) -> None:
    """Keep a history."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    path_of(case, way, seed).write_text(json.dumps(asdict(history)) + "\n")


def read(case: Case, way: str) -> list[History]:
    """All that there are, seed by seed."""
    paths = [path_of(case, way, seed) for seed in range(case.seeds)]
    return [History(**json.loads(path.read_text())) for path in paths if path.exists()]
