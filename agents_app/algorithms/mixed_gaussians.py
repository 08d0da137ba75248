"""Distributions over vectors of numbers, mixed with advice, for SB3's algorithms (arithmetic: advice.py).

Where the advice says nothing, they are the learner's own distribution: the same draws, densities, entropies and gradients.
"""

from __future__ import annotations

import copy
from typing import Any

import torch as th
from stable_baselines3.common.distributions import DiagGaussianDistribution, Distribution
from torch.distributions import Distribution as TorchDistribution
from torch.distributions import Normal, kl_divergence, register_kl

from agents_app.algorithms.advice import (
    Gaussian,
    acceptance,
    advisor_of,
    is_empty,
    product,
    reuse_log_density,
    says_nothing,
)
from agents_app.algorithms.mixing import LEARNER, Mixing


class _Mixed(DiagGaussianDistribution):
    """What both have in common."""

    def __init__(self, own: Distribution, advice: th.Tensor, mixing: Mixing) -> None:
        """`own`: the learner's distribution; its policy has one object, which every call changes."""
        normal: Any = own.distribution
        super().__init__(normal.mean.shape[-1])
        self.own, self.advice, self.mixing = copy.copy(own), advice, mixing
        self.learner: Gaussian[th.Tensor] = Gaussian(normal.mean, normal.stddev)
        self.neutral = says_nothing(advice)[..., None]  # (B, 1)

    def sample(self) -> th.Tensor:
        """Actions, (B, A). With neutral advice alone, no random number is drawn but the learner's."""
        own = self.own.sample()
        return own if self.neutral.all() else th.where(self.neutral, own, self._mix(own))

    def _mix(self, own: th.Tensor) -> th.Tensor:
        """Actions of the mixed policy, given some of the learner's, (B, A)."""
        raise NotImplementedError


class Accepted(_Mixed):
    """Policy Intersection by sampling, algorithm 1: actions of the advisor, drawn by the learner's density of them.

    For the learning rule it has the density of the normalised product, to which the draws tend with the number of samples.
    """

    def __init__(self, own: Distribution, advice: th.Tensor, mixing: Mixing) -> None:
        super().__init__(own, advice, mixing)
        self.distribution = Normal(*product(self.learner, advice, mixing.last_word))

    def _mix(self, own: th.Tensor) -> th.Tensor:
        advisor = advisor_of(self.learner, self.advice)
        noise = th.randn(self.mixing.samples, *own.shape)
        candidates = advisor.mean + advisor.deviation * noise  # (n, B, A)
        accepted = th.distributions.Categorical(logits=acceptance(candidates, self.learner, self.advice).T).sample()
        rest = own if self.mixing.last_word == LEARNER else candidates[0]
        return th.where(is_empty(self.learner, self.advice), rest, candidates[accepted, th.arange(len(own))])


class Reused(_Mixed):
    """Probabilistic Policy Reuse, eq. 2.5: with probability psi the advisor's action, else the learner's."""

    def __init__(self, own: Distribution, advice: th.Tensor, mixing: Mixing) -> None:
        super().__init__(own, advice, mixing)
        self.advisor = advisor_of(self.learner, advice)
        share = th.where(self.neutral, 1.0, 1.0 - mixing.psi)
        self.distribution: Any = Mixture(own.distribution, share)

    def log_prob(self, actions: th.Tensor) -> th.Tensor:
        """Logarithm of the density of the mixture, (B,)."""
        own = self.distribution.learner.log_prob(actions).sum(-1)
        mixed = reuse_log_density(actions, self.learner, self.advice, self.mixing.psi)
        return th.where(self.neutral[..., 0], own, mixed)

    def entropy(self) -> th.Tensor:
        """At least so much, (B,): that of a mixture has no closed form, but is above the mixture of both entropies."""
        own, advisor = Normal(*self.learner).entropy(), Normal(*self.advisor).entropy()
        share = self.distribution.share
        return th.where(self.neutral, own, share * own + (1.0 - share) * advisor).sum(-1)

    def mode(self) -> th.Tensor:
        """The mean of whoever acts more often, (B, A)."""
        return self.learner.mean if self.mixing.psi <= 0.5 else self.advisor.mean

    def _mix(self, own: th.Tensor) -> th.Tensor:
        advised = Normal(*self.advisor).sample()
        return th.where(th.rand(len(own), 1) < self.mixing.psi, advised, own)


class Mixture(TorchDistribution):
    """Of the learner's policy and an advisor's: just what TRPO asks, its distance from another one with the same advisor."""

    arg_constraints: dict[str, Any] = {}

    def __init__(self, learner: Any, share: th.Tensor) -> None:
        """`share`: of the learner, (B, 1)."""
        super().__init__(learner.batch_shape, validate_args=False)
        self.learner, self.share = learner, share


@register_kl(Mixture, Mixture)
def _kl_mixtures(one: Mixture, other: Mixture) -> th.Tensor:
    """At most so much, (B, A), for the divergence is convex: a step that keeps to this bound keeps to TRPO's."""
    return one.share * kl_divergence(one.learner, other.learner)
