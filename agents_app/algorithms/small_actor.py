"""Acting on the policy with a small network: what OnPolicyActor does, in NumPy, a fraction of the time (small_net.py)."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch as th
from gymnasium import spaces
from stable_baselines3.common.base_class import BaseAlgorithm

from agents_app.algorithms.actor import Memory
from agents_app.algorithms.mixing import Mixing
from agents_app.algorithms.on_policy import OnPolicyActor
from agents_app.algorithms.replay import Decision
from agents_app.algorithms.small_net import SmallNet, draw, gaussian_log_prob, log_softmax


class SmallActor(OnPolicyActor):
    """Draws from NumPy's generator. Raises Unsupported where the network is of another kind."""

    def __init__(self, algorithm: BaseAlgorithm) -> None:
        super().__init__(algorithm)
        self.net = SmallNet(self.policy)  # type: ignore[arg-type]
        self.correction = getattr(self.policy, "mixing", Mixing()).correction
        self._choose = self._choose_one if isinstance(self.action_space, spaces.Discrete) else self._choose_vector

    def decide(self, obs: Any, memory: Memory, mask: np.ndarray | None) -> tuple[Decision, Memory]:
        """Draw an action, with the advice in `obs` if there is any."""
        out, value = self.net.act_and_value(obs)
        advice = obs.get("advice") if isinstance(obs, dict) else None
        taken, env_action, log_prob = self._choose(out, advice)
        replay = (
            th.from_numpy(taken[None]),
            th.from_numpy(value[None]),
            th.from_numpy(np.array([log_prob], np.float32)),
        )
        return Decision(obs, env_action, replay), None

    def exploit(self, obs: Any, memory: Memory, mask: np.ndarray | None) -> tuple[Any, Memory]:
        """The most probable action of the learner's own policy."""
        out = self.net.act(obs)
        if isinstance(self.action_space, spaces.Discrete):
            return np.int64(out.argmax()), None
        bounds: Any = self.action_space
        return np.clip(out.reshape(bounds.shape), bounds.low, bounds.high), None

    def _choose_one(self, logits: np.ndarray, advice: np.ndarray | None) -> tuple[np.ndarray, Any, Any]:
        """Among n actions: what the rollout keeps, what the environment takes, the log-probability for the learner."""
        mixed = log_softmax(logits if advice is None else intersect(logits, advice))
        action = draw(mixed)
        seen = mixed if self.correction or advice is None else log_softmax(logits)
        return np.array(action), np.int64(action), seen[action]

    def _choose_vector(self, mean: np.ndarray, advice: np.ndarray | None) -> tuple[np.ndarray, Any, Any]:
        """A vector of real numbers; the environment gets it clipped to its bounds, as SB3 does."""
        mixed, deviation = mean if advice is None else halfway(mean, advice), self.net.deviations()
        flat = mixed + deviation * np.random.standard_normal(mean.shape).astype(np.float32)
        log_prob = gaussian_log_prob(flat, mixed if self.correction else mean, deviation)
        action = flat.reshape(self.action_space.shape)
        bounds: Any = self.action_space
        return action, np.clip(action, bounds.low, bounds.high), log_prob


def intersect(logits: np.ndarray, advice: np.ndarray) -> np.ndarray:
    """advice.intersect_logits (eq. 2.6) for one state."""
    log_advice = np.log(advice)
    return logits + (log_advice - log_advice.max())


def halfway(mean: np.ndarray, advice: np.ndarray) -> np.ndarray:
    """advice.intersect_mean (eq. 3.5) for one state."""
    advised, deviation = np.split(advice, 2)
    return np.where(np.isinf(deviation), mean, (mean + advised) / 2)
