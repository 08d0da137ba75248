"""Acting on the policy with a small network: what OnPolicyActor does, in NumPy, a fraction of the time (small_net.py)."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch as th
from gymnasium import spaces
from stable_baselines3.common.base_class import BaseAlgorithm

from agents_app.algorithms.actor import Memory
from agents_app.algorithms.advice import (
    Gaussian,
    acceptance,
    advisor_of,
    intersect_mean,
    is_empty,
    log_density,
    product,
    reuse_log_density,
    says_nothing,
)
from agents_app.algorithms.masks import allowed_of, mask_logits, mix_allowed
from agents_app.algorithms.mixing import INTERSECTION, LEARNER, SHAPING, Mixing
from agents_app.algorithms.on_policy import OnPolicyActor
from agents_app.algorithms.replay import Decision
from agents_app.algorithms.riders import ADVICE
from agents_app.algorithms.small_net import SmallNet, draw, log_softmax


class SmallActor(OnPolicyActor):
    """Draws from NumPy's generator. Raises Unsupported where the network is of another kind."""

    def __init__(self, algorithm: BaseAlgorithm) -> None:
        super().__init__(algorithm)
        self.net = SmallNet(self.policy)  # type: ignore[arg-type]
        self.mixing = getattr(self.policy, "mixing", Mixing())
        self._choose = self._choose_one if isinstance(self.action_space, spaces.Discrete) else self._choose_vector

    def decide(self, obs: Any, memory: Memory, mask: np.ndarray | None) -> tuple[Decision, Memory]:
        """Draw an action, with the advice and the mask in `obs` if there are any."""
        out, value = self.net.act_and_value(obs)
        advice = obs.get(ADVICE) if isinstance(obs, dict) else None
        taken, env_action, log_prob = self._choose(out, advice, allowed_of(obs))
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
            return np.int64(mask_logits(out, allowed_of(obs)).argmax()), None
        bounds: Any = self.action_space
        return np.clip(out.reshape(bounds.shape), bounds.low, bounds.high), None

    def _choose_one(
        self, logits: np.ndarray, advice: np.ndarray | None, allowed: np.ndarray | None
    ) -> tuple[np.ndarray, Any, Any]:
        """Among n actions: what the rollout keeps, what the environment takes, the log-probability for the learner."""
        mixed = log_softmax(mix_allowed(logits, advice, self.mixing, allowed))
        action = draw(mixed)
        seen = mixed if self.mixing.correction or advice is None else log_softmax(mask_logits(logits, allowed))
        return np.array(action), np.int64(action), seen[action]

    def _choose_vector(self, mean: np.ndarray, advice: np.ndarray | None, _: None) -> tuple[np.ndarray, Any, Any]:
        """A vector of real numbers; the environment gets it clipped to its bounds, as SB3 does."""
        own = Gaussian(mean, self.net.deviations())
        flat, log_prob = draw_vector(own, advice, self.mixing)
        if not self.mixing.correction:
            log_prob = log_density(flat, own)
        action = flat.reshape(self.action_space.shape)
        bounds: Any = self.action_space
        return action, np.clip(action, bounds.low, bounds.high), log_prob


def draw_vector(own: Gaussian[np.ndarray], advice: np.ndarray | None, mixing: Mixing) -> tuple[np.ndarray, np.ndarray]:
    """An action of the mixed policy, (A,), and the logarithm of its density. As advised.py does; mixed_gaussians.py."""
    if advice is not None and mixing.by_mean:
        own = Gaussian(intersect_mean(own.mean, advice, mixing.part), own.deviation)
        advice = None
    action = _normal(own)
    if advice is None or mixing.method == SHAPING or says_nothing(advice):
        return action, log_density(action, own)
    if mixing.method == INTERSECTION:
        return _draw_accepted(action, own, advice, mixing)
    if np.random.random() < mixing.psi:
        action = _normal(advisor_of(own, advice))
    return action, reuse_log_density(action, own, advice, mixing.psi)


def _draw_accepted(
    action: np.ndarray, own: Gaussian[np.ndarray], advice: np.ndarray, mixing: Mixing
) -> tuple[np.ndarray, np.ndarray]:
    """Algorithm 1, given an action of the learner's own for when nothing is accepted."""
    candidates = _normal(advisor_of(own, advice), mixing.samples)
    if not is_empty(own, advice):
        action = candidates[draw(log_softmax(acceptance(candidates, own, advice)))]
    elif mixing.last_word != LEARNER:
        action = candidates[0]
    return action, log_density(action, product(own, advice, mixing.last_word))


def _normal(policy: Gaussian[np.ndarray], *count: int) -> np.ndarray:
    """Draws, (A,) or (count, A)."""
    noise = np.random.standard_normal((*count, policy.mean.size)).astype(np.float32)
    return policy.mean + policy.deviation * noise
