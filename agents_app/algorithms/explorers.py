"""How the continuous algorithms off the policy explore at some states, and how that is mixed with advice (no learning here).

Actions are in SB3's units: their bounds are -1 and 1. Advice is (B, 2A): means, then deviations, in the same units.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import torch as th
from gymnasium import spaces
from stable_baselines3.common.noise import ActionNoise, OrnsteinUhlenbeckActionNoise

from agents_app.algorithms.advice import NOTHING, intersect_mean
from agents_app.algorithms.mixing import LEARNER, REUSE, Mixing

EDGE = 1e-6  # how near to the bounds a squashed action may be asked for: at the bounds themselves atanh is infinite
NODES, WEIGHTS = (th.tensor(part, dtype=th.float32) for part in np.polynomial.hermite_e.hermegauss(9))
WEIGHTS /= WEIGHTS.sum()  # sum_k WEIGHTS_k f(NODES_k) is the expectation of f under a standard Gaussian


class Explorer(Protocol):
    """A policy that explores, at B states."""

    def explore(self, advice: th.Tensor, part: float = 0.5) -> th.Tensor:
        """Actions (B, A) drawn from the analytic intersection with the advice, eq. 3.5, or with another part of the advisor.

        Action noise is not in them yet.
        """
        ...

    def log_density(self, actions: th.Tensor) -> th.Tensor:
        """Of each component of actions (N, B, A), less a constant, (N, B, A); action noise counts if there is no other."""
        ...


class Uniform:
    """SB3's warm-up: any action within the bounds, whose mean is the middle."""

    def explore(self, advice: th.Tensor, part: float = 0.5) -> th.Tensor:
        """Around half the advice, or another part."""
        middle = advice.new_zeros(advice.shape[0], advice.shape[1] // 2)
        return intersect_mean(middle, advice, part) + (2.0 * th.rand_like(middle) - 1.0)

    def log_density(self, actions: th.Tensor) -> th.Tensor:
        """The same everywhere."""
        return th.zeros_like(actions)


class Squashed:
    """SAC and TQC: a Gaussian, squashed by tanh.

    The mean that is mixed is that of the greedy action, tanh(mu). Between it and the advice, it is unsquashed again; to that the
    learner's own Gaussian noise is added (of its own deviation, or gSDE's), and the sum is squashed.
    """

    def __init__(self, actor: Any, obs: Any) -> None:
        self._distribution = actor.action_dist
        self._mean, self._log_std, self._others = actor.get_action_dist_params(obs)

    def explore(self, advice: th.Tensor, part: float = 0.5) -> th.Tensor:
        """Drawn half way to the advice, or another part of it, (B, A)."""
        between = intersect_mean(self._mean.tanh(), advice, part).clamp(EDGE - 1.0, 1.0 - EDGE).atanh()
        mixed = th.where(advice.chunk(2, dim=-1)[1].isinf(), self._mean, between)
        return self._distribution.actions_from_params(mixed, self._log_std, **self._others)

    def log_density(self, actions: th.Tensor) -> th.Tensor:
        """Of the Gaussian where the action comes from, over the slope of tanh there."""
        inside = actions.clamp(EDGE - 1.0, 1.0 - EDGE)
        return -0.5 * ((inside.atanh() - self._mean) / self._deviation()) ** 2 - (1.0 - inside**2).log()

    def greedy(self) -> th.Tensor:
        """The action without exploration, (B, A)."""
        return self._mean.tanh()

    def straying(self) -> th.Tensor:
        """How far actions are from the greedy one, the root of the mean square, (B, A); by quadrature."""
        drawn = (self._mean[..., None] + self._deviation()[..., None] * NODES).tanh()
        return ((drawn - self.greedy()[..., None]) ** 2 @ WEIGHTS).sqrt()

    def _deviation(self) -> th.Tensor:
        """Of the Gaussian, (B, A)."""
        return self._distribution.proba_distribution(self._mean, self._log_std, **self._others).distribution.stddev


class Noisy:
    """TD3 and DDPG: one action; the noise that the algorithm adds to it makes it a Gaussian."""

    def __init__(self, mean: th.Tensor, deviation: th.Tensor) -> None:
        """`mean`: (B, A); `deviation`: of the noise, (A,)."""
        self._mean, self._deviation = mean, deviation

    def explore(self, advice: th.Tensor, part: float = 0.5) -> th.Tensor:
        """Half way to the advice, or another part of it, (B, A)."""
        return intersect_mean(self._mean, advice, part)

    def log_density(self, actions: th.Tensor) -> th.Tensor:
        """Of the noise."""
        return -0.5 * ((actions - self._mean) / self._deviation) ** 2


def draw_mixed(explorer: Explorer, advice: th.Tensor, noise: Any, mixing: Mixing) -> th.Tensor:
    """Actions of the mixed policy, (B, A). The noise, (B, A) or 0, belongs to the learner's own action."""
    if mixing.by_mean:
        return (explorer.explore(advice, mixing.part) + noise).clamp(-1.0, 1.0)
    own = (explorer.explore(th.full_like(advice, th.inf)) + noise).clamp(-1.0, 1.0)
    if mixing.method == REUSE:
        return reuse_action(own, advice, mixing.psi)
    return intersect_by_sampling(explorer, own, advice, mixing)


def intersect_by_sampling(explorer: Explorer, own: th.Tensor, advice: th.Tensor, mixing: Mixing) -> th.Tensor:
    """Policy Intersection of continuous policies, algorithm 1, (B, A).

    Draws actions from the advisor, clipped to the bounds, weighs each by the learner's density of it, and draws one by its
    weight. Components without advice are the learner's `own`, (B, A), in all of them. Where beside `own` the learner would do
    none of them, the action is that of whoever has the last word.
    """
    candidates = draw_advice(own, advice, mixing.samples)  # (N, B, A)
    densities = explorer.log_density(th.cat([candidates, own[None]])).sum(-1)  # (N + 1, B)
    weights, usual = densities[:-1], densities[-1]
    accepted = (weights - th.empty_like(weights).exponential_().log()).argmax(0)  # (B,), drawn by exp(weights)
    rest = own if mixing.last_word == LEARNER else candidates[0]
    empty = weights.amax(0) - usual < NOTHING
    return th.where(empty[:, None], rest, candidates[accepted, th.arange(len(own))])


def reuse_action(own: th.Tensor, advice: th.Tensor, psi: float) -> th.Tensor:
    """Probabilistic Policy Reuse, eq. 2.5, (B, A): with probability psi the advisor's action, else the learner's own."""
    heeded = th.rand(len(own), 1) < psi
    return th.where(heeded, draw_advice(own, advice, 1)[0], own)


def draw_advice(own: th.Tensor, advice: th.Tensor, samples: int) -> th.Tensor:
    """Actions of the advisor, (N, B, A), clipped to the bounds; the learner's `own`, (B, A), where there is no advice."""
    mean, deviation = advice.chunk(2, dim=-1)
    said = deviation.isfinite()
    drawn = mean + deviation.where(said, th.zeros(())) * th.randn(samples, *mean.shape)
    return th.where(said, drawn.clamp(-1.0, 1.0), own)


def noise_deviation(noise: ActionNoise | None, action_space: spaces.Box) -> th.Tensor:
    """Of action noise, (A,), 0 without. That of Ornstein-Uhlenbeck's is what it comes to in time."""
    sigma: Any = getattr(noise, "_sigma", 0.0)
    if isinstance(noise, OrnsteinUhlenbeckActionNoise):
        kept = 1.0 - noise._theta * noise._dt
        sigma = sigma * np.sqrt(noise._dt / (1.0 - kept**2))
    return th.tensor(np.broadcast_to(sigma, action_space.shape).reshape(-1), dtype=th.float32)


def to_unit_bounds(action_space: spaces.Box, advice: th.Tensor) -> th.Tensor:
    """Advice in the units of the action space, (B, 2A), in SB3's."""
    middle, half = _middle_and_half(action_space)
    mean, deviation = advice.chunk(2, dim=-1)
    return th.cat([(mean - middle) / half, deviation / half], dim=-1)


def from_unit_bounds(action_space: spaces.Box, mean: th.Tensor, deviation: th.Tensor) -> tuple[th.Tensor, th.Tensor]:
    """Means and deviations, (B, A), in the units of the action space."""
    middle, half = _middle_and_half(action_space)
    return middle + half * mean, half * deviation


def _middle_and_half(action_space: spaces.Box) -> tuple[th.Tensor, th.Tensor]:
    low, high = th.as_tensor(action_space.low).flatten(), th.as_tensor(action_space.high).flatten()
    return (low + high) / 2, (high - low) / 2
