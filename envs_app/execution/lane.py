"""A vector of one ShepherdEnv, for SB3: without the copies and wrappers that a simulator needs, which cost more than it."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.vec_env import DummyVecEnv

from agents_app.algorithms.actor import batch


class Lane(DummyVecEnv):
    """SB3's own vector of environments, of one. Observations are handed on as they are: the record never changes."""

    def __init__(self, env: gym.Env) -> None:
        super().__init__([lambda: env])

    def reset(self) -> Any:
        """Wait for an episode to begin."""
        self._seeds, self._options = [None], [{}]
        obs, self.reset_infos[0] = self.envs[0].reset()
        return batch(obs)

    def step_wait(self) -> tuple[Any, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """What the action led to; after an end, the observation that begins the next episode."""
        obs, reward, terminated, truncated, info = self.envs[0].step(self.actions[0])
        done = terminated or truncated
        info["TimeLimit.truncated"] = truncated and not terminated
        if done:
            info["terminal_observation"] = obs
            obs, self.reset_infos[0] = self.envs[0].reset()
        return batch(obs), np.array([reward], np.float32), np.array([done]), [info]
