"""Games that are learned in seconds, on which algorithms prove that they learn."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from agents_app.algorithms.advice import advised_space, neutral_advice, with_advice


class SayWhatYouSee(gym.Env[Any, Any]):
    """Something new to see at each step; episodes of 10 steps. A subclass has the spaces, draws and rewards."""

    steps = 0
    seen: Any

    def reset(self, **kwargs: Any) -> tuple[Any, dict[str, Any]]:
        """Anywhere."""
        super().reset(seed=kwargs.get("seed"))
        self.steps = 0
        self.seen = self._draw()
        return self.seen, {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Something new to see."""
        reward = self._reward(action)
        self.steps += 1
        self.seen = self._draw()
        return self.seen, reward, False, self.steps >= 10, {}

    def _draw(self) -> Any:
        raise NotImplementedError

    def _reward(self, action: Any) -> float:
        raise NotImplementedError


class Identity(SayWhatYouSee):
    """Observations and actions: Discrete(n); 1 for the right action, else 0."""

    def __init__(self, n: int = 3) -> None:
        self.observation_space = self.action_space = spaces.Discrete(n)

    def _draw(self) -> Any:
        return self.np_random.integers(self.action_space.n)  # type: ignore[attr-defined]

    def _reward(self, action: Any) -> float:
        return float(action == self.seen)


class Point(SayWhatYouSee):
    """In numbers, Box(-1, 1); the reward is minus the squared distance."""

    def __init__(self) -> None:
        self.observation_space = spaces.Box(-1, 1, (1,), np.float32)
        self.action_space = spaces.Box(-1, 1, (1,), np.float32)

    def _draw(self) -> Any:
        return self.np_random.uniform(-1, 1, 1).astype(np.float32)

    def _reward(self, action: Any) -> float:
        return -float(((action - self.seen) ** 2).sum())


class Grid(gym.Env[Any, Any]):
    """From one corner of a room to the other. Discrete(side * side); left, right, up, down; -1 a step, and 20 at the goal.

    Ends at the goal, or is truncated after 50 steps. The best return is 20 - 2 (side - 1).
    """

    MOVES = ((-1, 0), (1, 0), (0, -1), (0, 1))

    def __init__(self, side: int = 4) -> None:
        self.side = side
        self.observation_space, self.action_space = spaces.Discrete(side * side), spaces.Discrete(4)
        self.x = self.y = self.steps = 0

    def reset(self, **kwargs: Any) -> tuple[Any, dict[str, Any]]:
        """In the corner."""
        super().reset(seed=kwargs.get("seed"))
        self.x = self.y = self.steps = 0
        return np.int64(0), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Walls stop."""
        dx, dy = self.MOVES[int(action)]
        self.x = min(max(self.x + dx, 0), self.side - 1)
        self.y = min(max(self.y + dy, 0), self.side - 1)
        self.steps += 1
        arrived = self.x == self.y == self.side - 1
        return np.int64(self.y * self.side + self.x), 20.0 * arrived - 1.0, arrived, self.steps >= 50, {}


class Advised(gym.ObservationWrapper[Any, Any, Any]):
    """The same game with advice beside the observation; neutral if none is given."""

    def __init__(self, env: gym.Env[Any, Any], advice: np.ndarray | None = None) -> None:
        super().__init__(env)
        self.observation_space = advised_space(env.observation_space, env.action_space)
        self.advice = neutral_advice(env.action_space) if advice is None else advice

    def observation(self, observation: Any) -> Any:
        """With the advice."""
        return with_advice(observation, self.advice)


def mean_return(model: Any, env: gym.Env[Any, Any], episodes: int = 20) -> float:
    """What the best known actions of the model bring in an episode."""
    total = 0.0
    for _ in range(episodes):
        obs, _ = env.reset()
        ended = False
        while not ended:
            obs, reward, terminated, truncated, _ = env.step(model.predict(obs, deterministic=True)[0])
            total, ended = total + float(reward), terminated or truncated
    return total / episodes
