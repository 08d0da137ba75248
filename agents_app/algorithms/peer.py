"""A policy that is asked what it would do, and does nothing itself."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import torch as th
from gymnasium import spaces
from stable_baselines3.common.utils import obs_as_tensor

from agents_app.algorithms.actor import batch
from agents_app.algorithms.advice import combine
from agents_app.algorithms.small_policies import small


class Peer:
    """A peer's policy, evaluated here; what it would do without advice of its own."""

    def __init__(self, policy: Any) -> None:
        self.policy = copy.deepcopy(policy)
        self._small = small(self.policy)

    def probabilities(self, obs: Any) -> np.ndarray:
        """Of each action, (A,); 0 for those that are not allowed."""
        if self._small is not None:
            return self._small.probabilities(obs)
        return self._distribution(obs).probs[0].numpy()

    def gaussian(self, obs: Any) -> tuple[np.ndarray, np.ndarray]:
        """Means (A,) and standard deviations (A,)."""
        if self._small is not None:
            return self._small.gaussian(obs)
        distribution = self._distribution(obs)
        return distribution.mean[0].numpy().reshape(-1), distribution.stddev[0].numpy().reshape(-1)

    def advice(self, obs: Any) -> np.ndarray:
        """What it would do, as advice rides in observations: (A,), or means and deviations, (2A,)."""
        if isinstance(self.policy.action_space, spaces.Discrete):
            return combine([self.probabilities(obs)], rho=1.0)
        return np.concatenate(self.gaussian(obs))

    def _distribution(self, obs: Any) -> Any:
        with th.no_grad():
            return self.policy.get_distribution(obs_as_tensor(batch(obs), self.policy.device)).distribution
