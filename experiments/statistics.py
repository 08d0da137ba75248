"""What the runs of two curves say about each other. A run counts once: its mean return over some episodes.

That is its area under the curve, divided by the episodes. (The thesis takes each episode of each run for a sample, table 4.1;
but episodes of one run are not independent, and p-values from them are too small.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from experiments.figure import Claim

SIGNIFICANT = 0.05
RESAMPLES = 10_000
NAN = float("nan")


@dataclass(frozen=True)
class Comparison:
    """Of two curves: by how much the first is above the second, and how sure that is. NaN with too few runs."""

    difference: float
    low: float  # the 95 % interval of the difference
    high: float
    welch: float  # p-values, two-sided
    wilcoxon: float
    runs: tuple[int, int]

    @property
    def enough(self) -> bool:
        """Whether there are two runs of each."""
        return min(self.runs) >= 2

    def verdict(self, claim: Claim) -> str:
        """Whether the claim holds, in words."""
        if not self.enough:
            return "too few runs"
        if self.welch >= SIGNIFICANT or np.isnan(self.welch):
            return "no difference seen"
        if claim.same:
            return "does not hold"
        return "holds" if self.difference > 0 else "the other way round"


def areas(curve: np.ndarray, first: int = 0, last: int | None = None) -> np.ndarray:
    """The mean return of each run, (runs,), from (runs, episodes)."""
    return curve[:, first:last].mean(axis=1)


def compare(ours: np.ndarray, theirs: np.ndarray) -> Comparison:
    """Of areas, (runs,) each. Wilcoxon's is the rank-sum test: runs of two curves are not pairs."""
    runs = (len(ours), len(theirs))
    if min(runs) < 2:
        return Comparison(NAN, NAN, NAN, NAN, NAN, runs)
    low, high = interval(ours, theirs)
    if np.ptp(ours) == 0 and np.ptp(theirs) == 0:  # without any spread there is no t
        welch = float(ours[0] == theirs[0])
    else:
        welch = float(stats.ttest_ind(ours, theirs, equal_var=False).pvalue)
    wilcoxon = float(stats.mannwhitneyu(ours, theirs).pvalue)
    return Comparison(float(ours.mean() - theirs.mean()), low, high, welch, wilcoxon, runs)


def interval(ours: np.ndarray, theirs: np.ndarray | None = None) -> tuple[float, float]:
    """The 95 % bootstrap interval (percentiles) of a mean, or of the difference of two. The same at each call."""
    rng = np.random.default_rng(0)
    means = _resampled(ours, rng) - (0.0 if theirs is None else _resampled(theirs, rng))
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)


def smooth(curve: np.ndarray, window: int) -> np.ndarray:
    """The moving average over the last episodes (fewer at the beginning), along the last axis."""
    sums = np.cumsum(np.concatenate([np.zeros((*curve.shape[:-1], 1)), curve], axis=-1), axis=-1)
    ends = np.arange(1, curve.shape[-1] + 1)
    begins = np.maximum(ends - window, 0)
    return (sums[..., ends] - sums[..., begins]) / (ends - begins)


def reached(curve: np.ndarray, goal: float, window: int) -> np.ndarray:
    """The episode at which each run's mean over a whole window has reached the goal, (runs,); infinite where never."""
    high = smooth(curve, window) >= goal
    high[:, : window - 1] = False
    return np.where(high.any(axis=1), high.argmax(axis=1) + 1.0, np.inf)


def _resampled(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return rng.choice(values, (RESAMPLES, len(values))).mean(axis=1)
