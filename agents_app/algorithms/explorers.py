"""How the continuous algorithms off the policy explore at some states, and how that is mixed with advice (no learning here).

Actions are in SB3's units: their bounds are -1 and 1. Advice is (B, 2A): means, then deviations, in the same units. All in NumPy:
nothing is learned from these numbers, and at a batch of one torch spends its time on calls.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.noise import ActionNoise, OrnsteinUhlenbeckActionNoise

from agents_app.algorithms.advice import NOTHING, halves, intersect_mean
from agents_app.algorithms.mixing import LEARNER, REUSE, Mixing

EDGE = 1e-6  # how near to the bounds a squashed action may be asked for: at the bounds themselves atanh is infinite
NODES, WEIGHTS = (part.astype(np.float32) for part in np.polynomial.hermite_e.hermegauss(9))
WEIGHTS /= WEIGHTS.sum()  # sum_k WEIGHTS_k f(NODES_k) is the expectation of f under a standard Gaussian


class Explorer(Protocol):
    """A policy that explores, at B states."""

    def explore(self, advice: np.ndarray, part: float = 0.5) -> np.ndarray:
        """Actions (B, A) drawn from the analytic intersection with the advice, eq. 3.5, or with another part of the advisor.

        Action noise is not in them yet.
        """
        ...

    def log_density(self, actions: np.ndarray) -> np.ndarray:
        """Of each component of actions (N, B, A), less a constant, (N, B, A); action noise counts if there is no other."""
        ...


class Uniform:
    """SB3's warm-up: any action within the bounds, whose mean is the middle."""

    def explore(self, advice: np.ndarray, part: float = 0.5) -> np.ndarray:
        """Around half the advice, or another part."""
        shape = len(advice), advice.shape[1] // 2
        anywhere = np.random.uniform(-1.0, 1.0, shape).astype(np.float32)
        return intersect_mean(np.zeros(shape, np.float32), advice, part) + anywhere

    def log_density(self, actions: np.ndarray) -> np.ndarray:
        """The same everywhere."""
        return np.zeros_like(actions)


class Squashed:
    """SAC and TQC: a Gaussian, squashed by tanh.

    The mean that is mixed is that of the greedy action, tanh(mu). Between it and the advice, it is unsquashed again; to that the
    learner's own Gaussian noise is added (of its own deviation, or gSDE's), and the sum is squashed.
    """

    def __init__(
        self, mean: np.ndarray, deviation: np.ndarray, draw: Callable[[np.ndarray], np.ndarray] | None = None
    ) -> None:
        """Of the Gaussian, both (B, A). `draw`: squashed actions around other means (B, A), where the noise is no Gaussian's."""
        self._mean, self._deviation, self._draw = mean, deviation, draw or self._draw_gaussian

    def explore(self, advice: np.ndarray, part: float = 0.5) -> np.ndarray:
        """Drawn half way to the advice, or another part of it, (B, A)."""
        between = np.arctanh(_inside(intersect_mean(self.greedy(), advice, part)))
        return self._draw(np.where(np.isinf(halves(advice)[1]), self._mean, between))

    def draw(self) -> np.ndarray:
        """Without advice, (B, A)."""
        return self._draw(self._mean)

    def log_density(self, actions: np.ndarray) -> np.ndarray:
        """Of the Gaussian where the action comes from, over the slope of tanh there."""
        inside = _inside(actions)
        return -0.5 * ((np.arctanh(inside) - self._mean) / self._deviation) ** 2 - np.log(1.0 - inside**2)

    def greedy(self) -> np.ndarray:
        """The action without exploration, (B, A)."""
        return np.tanh(self._mean)

    def straying(self) -> np.ndarray:
        """How far actions are from the greedy one, the root of the mean square, (B, A); by quadrature."""
        drawn = np.tanh(self._mean[..., None] + self._deviation[..., None] * NODES)
        return np.sqrt((drawn - self.greedy()[..., None]) ** 2 @ WEIGHTS)

    def _draw_gaussian(self, mean: np.ndarray) -> np.ndarray:
        return np.tanh(mean + self._deviation * _normal(mean.shape))


class Noisy:
    """TD3 and DDPG: one action; the noise that the algorithm adds to it makes it a Gaussian."""

    def __init__(self, mean: np.ndarray, deviation: np.ndarray) -> None:
        """`mean`: (B, A); `deviation`: of the noise, (A,)."""
        self._mean, self._deviation = mean, deviation

    def explore(self, advice: np.ndarray, part: float = 0.5) -> np.ndarray:
        """Half way to the advice, or another part of it, (B, A)."""
        return intersect_mean(self._mean, advice, part)

    def draw(self) -> np.ndarray:
        """Without advice, (B, A): the noise is the algorithm's own."""
        return self._mean

    def log_density(self, actions: np.ndarray) -> np.ndarray:
        """Of the noise."""
        return -0.5 * ((actions - self._mean) / self._deviation) ** 2

    def greedy(self) -> np.ndarray:
        """The action without exploration, (B, A)."""
        return self._mean

    def straying(self) -> np.ndarray:
        """How far actions are from the greedy one, (B, A)."""
        return np.broadcast_to(self._deviation, self._mean.shape)


def draw_mixed(explorer: Explorer, advice: np.ndarray, noise: Any, mixing: Mixing) -> np.ndarray:
    """Actions of the mixed policy, (B, A). The noise, (B, A) or 0, belongs to the learner's own action."""
    if mixing.by_mean:
        return _within(explorer.explore(advice, mixing.part) + noise)
    own = _within(explorer.explore(np.full_like(advice, np.inf)) + noise)
    if mixing.method == REUSE:
        return reuse_action(own, advice, mixing.psi)
    return intersect_by_sampling(explorer, own, advice, mixing)


def intersect_by_sampling(explorer: Explorer, own: np.ndarray, advice: np.ndarray, mixing: Mixing) -> np.ndarray:
    """Policy Intersection of continuous policies, algorithm 1, (B, A).

    Draws actions from the advisor, clipped to the bounds, weighs each by the learner's density of it, and draws one by its
    weight. Components without advice are the learner's `own`, (B, A), in all of them. Where beside `own` the learner would do
    none of them, the action is that of whoever has the last word.
    """
    candidates = draw_advice(own, advice, mixing.samples)  # (N, B, A)
    densities = explorer.log_density(np.concatenate([candidates, own[None]])).sum(-1)  # (N + 1, B)
    weights, usual = densities[:-1], densities[-1]
    accepted = (weights + np.random.gumbel(size=weights.shape)).argmax(0)  # (B,), drawn by exp(weights)
    rest = own if mixing.last_word == LEARNER else candidates[0]
    empty = weights.max(0) - usual < NOTHING
    return np.where(empty[:, None], rest, candidates[accepted, np.arange(len(own))])


def reuse_action(own: np.ndarray, advice: np.ndarray, psi: float) -> np.ndarray:
    """Probabilistic Policy Reuse, eq. 2.5, (B, A): with probability psi the advisor's action, else the learner's own."""
    heeded = np.random.random((len(own), 1)) < psi
    return np.where(heeded, draw_advice(own, advice, 1)[0], own)


def draw_advice(own: np.ndarray, advice: np.ndarray, samples: int) -> np.ndarray:
    """Actions of the advisor, (N, B, A), clipped to the bounds; the learner's `own`, (B, A), where there is no advice."""
    mean, deviation = halves(advice)
    said = np.isfinite(deviation)
    drawn = mean + np.where(said, deviation, 0.0) * _normal((samples, *mean.shape))
    return np.where(said, _within(drawn), own)


def noise_deviation(noise: ActionNoise | None, action_space: spaces.Box) -> np.ndarray:
    """Of action noise, (A,), 0 without. That of Ornstein-Uhlenbeck's is what it comes to in time."""
    sigma: Any = getattr(noise, "_sigma", 0.0)
    if isinstance(noise, OrnsteinUhlenbeckActionNoise):
        kept = 1.0 - noise._theta * noise._dt
        sigma = sigma * np.sqrt(noise._dt / (1.0 - kept**2))
    return np.broadcast_to(sigma, action_space.shape).reshape(-1).astype(np.float32)


def to_unit_bounds(action_space: spaces.Box, advice: np.ndarray) -> np.ndarray:
    """Advice in the units of the action space, (B, 2A), in SB3's."""
    middle, half = _middle_and_half(action_space)
    mean, deviation = halves(advice)
    return np.concatenate([(mean - middle) / half, deviation / half], axis=-1)


def from_unit_bounds(
    action_space: spaces.Box, mean: np.ndarray, deviation: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Means and deviations, (B, A), in the units of the action space."""
    middle, half = _middle_and_half(action_space)
    return middle + half * mean, half * deviation


def _middle_and_half(action_space: spaces.Box) -> tuple[np.ndarray, np.ndarray]:
    low, high = action_space.low.reshape(-1), action_space.high.reshape(-1)
    return (low + high) / 2, (high - low) / 2


def _normal(shape: tuple[int, ...]) -> np.ndarray:
    return np.random.standard_normal(shape).astype(np.float32)


def _within(actions: np.ndarray) -> np.ndarray:
    return np.clip(actions, -1.0, 1.0)


def _inside(actions: np.ndarray) -> np.ndarray:
    """Where atanh is finite."""
    return np.clip(actions, EDGE - 1.0, 1.0 - EDGE)
