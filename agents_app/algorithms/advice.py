"""The arithmetic of advice (reference: actor_advisor.md section 1; thesis 2.5, 3.2.1, 5.2.1, 5.3.1).

Discrete advice is a vector (A,) of probabilities; continuous advice is (2A,): means, then standard deviations. Neutral advice,
all ones or an infinite deviation, changes nothing, to the bit. Each equation is written once, for torch and for NumPy, and for
batches and single states alike: the last dimension is that of the actions.
"""

from __future__ import annotations

import math
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
import torch as th
from gymnasium import spaces

from agents_app.algorithms.mixing import GEOMETRIC, INTERSECTION, LEARNER, REUSE, UNION, Mixing
from agents_app.algorithms.riders import ADVICE, space_with_rider, with_rider, without_riders

FLOOR = 1e-6  # added to soft advice, so that the learner can always push back
NOTHING = -87.0  # the logarithm of what float32 rounds to nothing
IMPOSSIBLE = -200.0  # in place of the logarithm of 0: finite, and nothing even beside a learner who is sure of it
TINY = float(np.finfo(np.float32).tiny)
HARD, LOOSE = 1e-4, 1e8  # the deviations of an advisor lie in between: densities and gradients stay finite
LARGEST_DENSITY = 1e6  # as a reward
HALF_LOG_2PI = 0.5 * math.log(2 * math.pi)

Array = TypeVar("Array", np.ndarray, th.Tensor)


class Gaussian(NamedTuple, Generic[Array]):
    """A policy over vectors of numbers, independent in each dimension."""

    mean: Array  # (..., A)
    deviation: Array  # (..., A)


# --- what advice is ---


def advice_space(action_space: spaces.Space) -> spaces.Box:
    """Where advice for these actions lives: (A,) probabilities, or their multiple; or (2A,) means and deviations."""
    if isinstance(action_space, spaces.Discrete):
        return spaces.Box(0.0, np.inf, (int(action_space.n),), np.float32)
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


def is_neutral(advice: Array) -> Array:
    """Whether probabilities say nothing: all ones, which a distribution never is. (..., A) -> (..., 1)."""
    return _library(advice).all(advice == 1.0, axis=-1, keepdims=True)


def combine(advice: list[np.ndarray], rho: float) -> np.ndarray:
    """One vector from the probabilities of several advisors, eq. 5.1: 1/N sum_i (pi_i + 1 - rho), normalised to sum to 1."""
    mixed = sum(advice[1:], advice[0]) / len(advice) + (1.0 - rho + FLOOR)
    return (mixed / mixed.sum(-1, keepdims=True)).astype(np.float32)


def combine_logs(advice: list[np.ndarray], rho: float) -> np.ndarray:
    """The same by the geometric mean: prod_i (pi_i + 1 - rho)^(1/N), normalised to sum to N: geometric_logits counts so."""
    logs = [np.log(each + (1.0 - rho + FLOOR)) for each in advice]
    mixed = np.exp(sum(logs[1:], logs[0]) / len(logs))
    return (len(advice) / mixed.sum(-1, keepdims=True) * mixed).astype(np.float32)


def as_order(advice: np.ndarray, action_space: spaces.Space) -> np.ndarray:
    """Deterministic advice (thesis 3.1.1): the most probable action, one-hot; or the mean, exact to 1/1000 of the range.

    Of equally probable actions, any; where all are, it is neutral.
    """
    if isinstance(action_space, spaces.Discrete):
        best = advice == advice.max()
        return (best if best.all() else best / best.sum()).astype(np.float32)
    assert isinstance(action_space, spaces.Box)
    mean, deviation = halves(advice)
    exact = 1e-3 * (action_space.high - action_space.low).reshape(-1)
    return np.concatenate([mean, np.where(np.isinf(deviation), deviation, exact)]).astype(np.float32)


# --- discrete actions: policies are unnormalised log-probabilities, (..., A), and so are the results ---


def mix_logits(logits: Array, advice: Array, mixing: Mixing) -> Array:
    """The policy that acts. The softmax over the result normalises it."""
    if mixing.method == INTERSECTION:
        return intersect_logits(logits, advice, mixing.last_word)
    if mixing.method == GEOMETRIC:
        return geometric_logits(logits, advice, mixing.weight)
    if mixing.method in (UNION, REUSE):
        return reuse_logits(logits, advice, mixing.share)
    return logits


def intersect_logits(logits: Array, advice: Array, last_word: str = LEARNER) -> Array:
    """Policy Intersection, eq. 2.6: p(a) = pi_L(a) pi_A(a) / sum_b pi_L(b) pi_A(b).

    Where the sum is nothing, what remains is the policy of whoever has the last word (thesis 3.2.1, footnote 4).
    """
    said = _log_advice(advice)
    if said.min() > NOTHING:  # nothing is ruled out, so that the sum is more than nothing, whatever the learner does
        return logits + said
    empty = _log_sum(logits - _log_sum(logits) + said) < NOTHING
    return _library(logits).where(empty, logits if last_word == LEARNER else said, logits + said)


def geometric_logits(logits: Array, advice: Array, weight: float) -> Array:
    """The weighted geometric mean of the learner and N advisors: p(a) is (pi_L(a) prod_i pi_i(a)^w)^(1 / (1 + w N)), normalised.

    The logarithmic opinion pool (Genest and Zidek 1986). Where all agree it is as sure as they are; the intersection is surer.
    `advice` is the geometric mean of theirs, and its sum is N, which is 1 where there is one.
    """
    xp = _library(advice)
    weights = weight * xp.sum(advice, axis=-1, keepdims=True)
    mixed = (logits + weights * _log_advice(advice)) / (1.0 + weights)
    return xp.where(is_neutral(advice), logits, mixed)


def reuse_logits(logits: Array, advice: Array, psi: float) -> Array:
    """Probabilistic Policy Reuse, eq. 2.5: p = psi pi_A + (1 - psi) pi_L.

    To take the advisor's action with probability psi, else one's own, is to draw from this mixture. With psi = 1/2 it is
    Policy Union, eq. 3.2: (pi_L + pi_A) / sum.
    """
    xp, said = _library(logits), _log_advice(advice)
    own, advised = logits - _log_sum(logits), said - _log_sum(said)
    mixed = xp.logaddexp(own + _log(1.0 - psi), advised + _log(psi))
    return xp.where(is_neutral(advice), logits, mixed)


def _log_advice(advice: Array) -> Array:
    """Logarithms of the probabilities, up to a constant: 0 for the most probable action."""
    xp = _library(advice)
    relative = advice / xp.amax(advice, axis=-1, keepdims=True)
    never = relative == 0
    return xp.where(never, IMPOSSIBLE, xp.log(relative + never))


def _log_sum(logits: Array) -> Array:
    """log sum_a exp(x_a), (..., 1)."""
    xp = _library(logits)
    top = xp.amax(logits, axis=-1, keepdims=True)
    return top + xp.log(xp.sum(xp.exp(logits - top), axis=-1, keepdims=True))


def _log(share: float) -> float:
    return math.log(max(share, TINY))


# --- continuous actions ---


def intersect_mean(mean: Array, advice: Array, part: float = 0.5) -> Array:
    """The mean of the analytic intersection, eq. 3.5: (mu_L + mu_A) / 2, (..., A); sigma stays pi_L's.

    With another part w of the advisor, (1 - w) mu_L + w mu_A: the geometric mean of two Gaussians of one deviation.
    """
    advised, deviation = halves(advice)
    xp = _library(mean)
    return xp.where(xp.isinf(deviation), mean, (1.0 - part) * mean + part * advised)


def advisor_of(own: Gaussian[Array], advice: Array) -> Gaussian[Array]:
    """The advisor's policy; in dimensions of which it says nothing, the learner's own."""
    mean, deviation = halves(advice)
    xp = _library(advice)
    silent = xp.isinf(deviation)
    return Gaussian(xp.where(silent, own.mean, mean), xp.where(silent, own.deviation, xp.clip(deviation, HARD, LOOSE)))


def product(own: Gaussian[Array], advice: Array, last_word: str = LEARNER) -> Gaussian[Array]:
    """The normalised product of both densities: what algorithm 1 draws from, but for the number of its samples.

    Where it is empty, the policy of whoever has the last word.
    """
    xp, advisor = _library(advice), advisor_of(own, advice)
    looser = advisor.deviation / own.deviation
    share = 1 / (1 + looser**2)  # of the advisor in the mean
    agreed = own.mean + share * (advisor.mean - own.mean), advisor.deviation * share**0.5
    rest = own if last_word == LEARNER else advisor
    keep, empty = xp.isinf(halves(advice)[1]), is_empty(own, advice)
    mean, deviation = (
        xp.where(keep, mine, xp.where(empty, left, both)) for mine, left, both in zip(own, rest, agreed, strict=True)
    )
    return Gaussian(mean, deviation)


def is_empty(own: Gaussian[Array], advice: Array) -> Array:
    """Whether no action is probable to both: the integral of the product, beside that of equal means, is nothing. (..., 1)."""
    xp, advisor = _library(advice), advisor_of(own, advice)
    apart = (advisor.mean - own.mean) ** 2 / (own.deviation**2 + advisor.deviation**2)
    return -0.5 * xp.sum(apart, axis=-1, keepdims=True) < NOTHING


def acceptance(candidates: Array, own: Gaussian[Array], advice: Array) -> Array:
    """Algorithm 1: how much the learner likes each of n actions of the advisor, (n, ..., A) -> (n, ...).

    Logarithms of its density, up to a constant. Dimensions in which the candidates are the learner's own do not count.
    """
    xp = _library(advice)
    apart = (candidates - own.mean) / own.deviation
    return -0.5 * xp.sum(xp.where(xp.isinf(halves(advice)[1]), 0.0, apart) ** 2, axis=-1)


def log_density(actions: Array, policy: Gaussian[Array]) -> Array:
    """The logarithm of the density of actions (..., A), summed over the dimensions, (...)."""
    xp = _library(actions)
    apart = (actions - policy.mean) / policy.deviation
    return xp.sum(-0.5 * apart**2 - xp.log(policy.deviation) - HALF_LOG_2PI, axis=-1)


def reuse_log_density(actions: Array, own: Gaussian[Array], advice: Array, psi: float) -> Array:
    """Eq. 2.5 as a density, (...): psi pi_A + (1 - psi) pi_L, a mixture of two Gaussians."""
    xp = _library(actions)
    mine, advised = log_density(actions, own), log_density(actions, advisor_of(own, advice))
    mixed = xp.logaddexp(mine + _log(1.0 - psi), advised + _log(psi))
    return xp.where(says_nothing(advice), mine, mixed)


def says_nothing(advice: Array) -> Array:
    """Whether means and deviations, (..., 2A), say nothing in any dimension. (...)."""
    xp = _library(advice)
    return xp.all(xp.isinf(halves(advice)[1]), axis=-1)


def halves(advice: Array) -> tuple[Array, Array]:
    """Means and deviations, both (..., A), of (..., 2A)."""
    half = advice.shape[-1] // 2
    return advice[..., :half], advice[..., half:]


def _library(array: Any) -> Any:
    """Torch or NumPy: what is used of them here has the same names in both."""
    return th if isinstance(array, th.Tensor) else np


# --- advice as a reward ---


def shaping_reward(advice: np.ndarray, action: Any) -> float:
    """Reward shaping from an advisor, thesis 5.2.1: pi_A(s, a), a probability or a density. 0 where the advisor is silent."""
    if np.ndim(action) == 0:
        return 0.0 if is_neutral(advice).all() else float(advice[int(action)] / advice.sum())
    mean, deviation = halves(advice)
    told = ~np.isinf(deviation)
    if not told.any():
        return 0.0
    policy = Gaussian(mean[told], np.clip(deviation[told], HARD, LOOSE))
    return float(np.exp(min(log_density(np.reshape(action, -1)[told], policy), math.log(LARGEST_DENSITY))))


# --- how advice rides in observations ---


def advised_space(observation_space: spaces.Space, action_space: spaces.Space) -> spaces.Dict:
    """The observation space with `advice` beside what the client sends."""
    return space_with_rider(observation_space, ADVICE, advice_space(action_space))


def with_advice(obs: Any, advice: np.ndarray) -> dict[str, Any]:
    """An observation of `advised_space`."""
    return with_rider(obs, ADVICE, advice)


def without_advice(obs: Any) -> Any:
    """All the rest."""
    return without_riders(obs, ADVICE)
