"""A curve that is learned in this process: an algorithm as executions build it, on an environment, with advice or without."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from shepherd_client.spaces import spaces_of
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback

from agents_app.algorithms.builder import build
from agents_app.algorithms.mixing import SHAPING
from agents_app.algorithms.spec import AgentSpec
from agents_app.algorithms.teaching import Advise, Advised, Judged, shaped_by
from benchmarks.histories import Log, Recorder
from experiments.acting import act_in_numpy
from experiments.advisors import UNIFORM, load, uniform
from experiments.figure import Episodes

ENDLESS = 2**62  # steps


@dataclass(frozen=True)
class InProcess:
    """The settings. `agent`: fields of AgentSpec beside these, such as its advice settings."""

    environment: str
    episodes: int
    algorithm: str = "PPO"
    parameters: dict[str, Any] = field(default_factory=dict)
    agent: dict[str, Any] = field(default_factory=dict)
    advisor: str = ""  # UNIFORM, or one of those of advisors.py
    scale: float = 1.0  # what the numbers of observations are multiplied with
    shift: float = 0.0  # what is added then
    tried: int = 0  # of the episodes, the last so many only try out what was learned: its best actions, nothing learned

    @property
    def advisors(self) -> tuple[str, ...]:
        """What must be trained before."""
        return (self.advisor,) if self.advisor not in ("", UNIFORM) else ()

    def learn(self, seed: int, saves: Path, on_episode: Callable[[], None]) -> list[Episodes]:
        """One run of one learner."""
        log = Log()
        env: gym.Env = Recorder(gym.make(self.environment), log)
        if (self.scale, self.shift) != (1.0, 0.0):
            env = Scaled(env, self.scale, self.shift)
        if self.advisor:
            advise = self._advise(env, saves)
            shaped = self.agent.get("advice_method") == SHAPING
            env = Advised(Judged(env, shaped_by(advise)) if shaped else env, advise)
        algorithm = build(spec_of(env, self.algorithm, self.parameters, **self.agent), env, seed)
        act_in_numpy(algorithm)
        algorithm.learn(ENDLESS, callback=StopAfter(self.episodes - self.tried, log, on_episode))
        for _ in range(self.tried):
            try_out(algorithm, env)
            on_episode()
        return [log.episodes]

    def _advise(self, env: gym.Env, saves: Path) -> Advise:
        return uniform(env.action_space) if self.advisor == UNIFORM else load(self.advisor, saves)


def try_out(algorithm: BaseAlgorithm, env: gym.Env) -> None:
    """One episode of the best actions that an algorithm knows."""
    observation, over = env.reset()[0], False
    while not over:
        action, _ = algorithm.predict(observation, deterministic=True)
        observation, _, terminated, truncated, _ = env.step(action)
        over = terminated or truncated


def spec_of(env: gym.Env, algorithm: str, parameters: dict[str, Any], **fields: Any) -> AgentSpec:
    """An agent for an environment."""
    notes = spaces_of(env.unwrapped)
    return AgentSpec(algorithm, notes.action_space, notes.observation_space, parameters=parameters, **fields)


class Scaled(gym.ObservationWrapper):
    """The same environment, told in other units."""

    def __init__(self, env: gym.Env, scale: float, shift: float) -> None:
        super().__init__(env)
        assert isinstance(env.observation_space, gym.spaces.Box)
        self.scale, self.shift = scale, shift
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, env.observation_space.shape)

    def observation(self, observation: Any) -> np.ndarray:
        """As a client would send it, rounded to float32."""
        return (np.asarray(observation, np.float64) * self.scale + self.shift).astype(np.float32)


class StopAfter(BaseCallback):
    """Ends learning after a number of episodes."""

    def __init__(self, episodes: int, log: Log, on_episode: Callable[[], None]) -> None:
        super().__init__()
        self.episodes, self.log, self.on_episode, self.seen = episodes, log, on_episode, 0

    def _on_step(self) -> bool:
        for _ in range(self.seen, len(self.log.episodes)):
            self.on_episode()
        self.seen = len(self.log.episodes)
        return self.seen < self.episodes
