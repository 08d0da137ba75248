"""ShepherdEnv-v0: the mock Gymnasium environment through which an algorithm meets a client (thesis 5.5.1, figure 5.17).

It simulates nothing. A feed says what the client sent: a Tape, when a learner replays what an actor did, or a LiveFeed, when
the algorithm plays itself and waits for the client.
"""

from __future__ import annotations

from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from agents_app.algorithms.replay import Outcome


class Feed(Protocol):
    """Where the environment's answers come from."""

    def first(self) -> Any:
        """The observation that begins an episode."""
        ...

    def advance(self, action: Any) -> Outcome:
        """What the action led to."""
        ...


class ShepherdEnv(gym.Env[Any, Any]):
    """Observations, actions, rewards and ends are the client's.

    - Spaces: those of the agent; with advice, the observation is a dictionary that has `advice` too.
    - Start: the client's first observation of an episode. `seed` and `options` change nothing: the client draws its own start.
    - End: `terminated` and `truncated` as the client says; pieces of long episodes are truncated.
    """

    metadata = {"render_modes": []}

    def __init__(self, observation_space: spaces.Space, action_space: spaces.Space, feed: Feed) -> None:
        self.observation_space = observation_space
        self.action_space = action_space
        self.feed = feed

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Wait for an episode to begin."""
        super().reset(seed=seed)
        return self.feed.first(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Give the action to the client, or check that it is the one it had, and wait for its outcome."""
        outcome = self.feed.advance(action)
        info = {"client": outcome.info} if outcome.info else {}  # apart, for SB3 gives some names a meaning
        return outcome.obs, outcome.reward, outcome.terminated, outcome.truncated, info

    def action_masks(self) -> np.ndarray:
        """Which actions are allowed where the episode stands, (A,) of bool (MaskablePPO asks for it)."""
        decision = getattr(self.feed, "current", None)
        mask = decision.mask if decision is not None else getattr(self.feed, "mask", None)
        return np.ones(self.action_space.n, bool) if mask is None else mask  # type: ignore[attr-defined]


gym.register(
    "ShepherdEnv-v0",
    entry_point="envs_app.shepherd_env:ShepherdEnv",
    disable_env_checker=True,
    order_enforce=False,  # the feed knows the order
    nondeterministic=True,  # whatever the seed
)
