"""The arithmetic of advice (reference: actor_advisor.md section 1; thesis 2.5.2, 3.2.1, 5.3.1).

Discrete advice is a vector (A,) of probabilities; continuous advice is (2A,): means, then standard deviations. Neutral advice,
all ones or an infinite deviation, changes nothing, to the bit.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch as th
from gymnasium import spaces

PLAIN = "_observation"  # the key of what the client sends, when it sends no dictionary
FLOOR = 1e-6  # added to soft advice, so that the learner can always push back


def advice_space(action_space: spaces.Space) -> spaces.Box:
    """Where advice for these actions lives: (A,) probabilities, or (2A,) means and deviations."""
    if isinstance(action_space, spaces.Discrete):
        return spaces.Box(0.0, 1.0, (int(action_space.n),), np.float32)
    assert isinstance(action_space, spaces.Box)
    return spaces.Box(-np.inf, np.inf, (2 * int(np.prod(action_space.shape)),), np.float32)


def neutral_advice(action_space: spaces.Space) -> np.ndarray:
    """Advice that says nothing: ones, or means of 0 with infinite deviations."""
    shape = advice_space(action_space).shape
    advice = np.ones(shape, np.float32)
    if isinstance(action_space, spaces.Box):
        half = shape[0] // 2
        advice[:half], advice[half:] = 0.0, np.inf
    return advice


def combine(advice: list[np.ndarray], rho: float) -> np.ndarray:
    """One vector from the probabilities of several advisors, eq. 5.1: 1/N sum_i (pi_i + 1 - rho), normalised to sum to 1."""
    mixed = sum(advice[1:], advice[0]) / len(advice) + (1.0 - rho + FLOOR)
    return (mixed / mixed.sum()).astype(np.float32)


def intersect_logits(logits: th.Tensor, advice: th.Tensor) -> th.Tensor:
    """Policy Intersection of discrete policies, eq. 2.6, as unnormalised log-probabilities, (B, A).

    p(a) = pi_L(a) pi_A(a) / sum_b pi_L(b) pi_A(b); the softmax over the result divides by the sum.
    """
    log_advice = th.log(advice)
    return logits + (log_advice - log_advice.max(dim=-1, keepdim=True).values)


def intersect_mean(mean: th.Tensor, advice: th.Tensor) -> th.Tensor:
    """The mean of the analytic intersection of Gaussian policies, eq. 3.5: (mu_L + mu_A) / 2, (B, A); sigma stays pi_L's."""
    advised, deviation = advice.chunk(2, dim=-1)
    return th.where(th.isinf(deviation), mean, (mean + advised) / 2)


def advised_space(observation_space: spaces.Space, action_space: spaces.Space) -> spaces.Dict:
    """The observation space with `advice` beside what the client sends."""
    keys = observation_space.spaces if isinstance(observation_space, spaces.Dict) else {PLAIN: observation_space}
    return spaces.Dict({**keys, "advice": advice_space(action_space)})


def with_advice(obs: Any, advice: np.ndarray) -> dict[str, Any]:
    """An observation of `advised_space`."""
    return {**(obs if isinstance(obs, dict) else {PLAIN: obs}), "advice": advice}


def without_advice(obs: Any) -> Any:
    """What the client sent: the network never sees the advice."""
    if not isinstance(obs, dict) or "advice" not in obs:
        return obs
    rest = {key: value for key, value in obs.items() if key != "advice"}
    return rest.get(PLAIN, rest)


def plain_space(space: spaces.Space) -> spaces.Space:
    """The observation space without `advice`."""
    if not isinstance(space, spaces.Dict) or "advice" not in space.spaces:
        return space
    rest = {key: value for key, value in space.spaces.items() if key != "advice"}
    return rest[PLAIN] if PLAIN in rest else spaces.Dict(rest)
