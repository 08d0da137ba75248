"""The statistics of the experiments agree with scipy and with numbers that are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from experiments.figure import Claim
from experiments.statistics import areas, compare, interval, reached, smooth

OURS, THEIRS = np.array([210.0, 195, 230, 188]), np.array([150.0, 120, 171, 160])
UP, SAME = Claim("panel", "a", "b"), Claim("panel", "a", "b", same=True)


def test_an_area_is_the_mean_return_of_a_run_between_two_episodes() -> None:
    curve = np.arange(20.0).reshape(2, 10)
    assert areas(curve).tolist() == [4.5, 14.5]
    assert areas(curve, 2, 4).tolist() == [2.5, 12.5]


def test_p_values_are_scipys() -> None:
    seen = compare(OURS, THEIRS)
    assert seen.difference == pytest.approx(55.5)
    assert seen.welch == pytest.approx(stats.ttest_ind(OURS, THEIRS, equal_var=False).pvalue)
    assert seen.wilcoxon == pytest.approx(stats.ranksums(OURS, THEIRS).pvalue, abs=0.01)
    assert seen.wilcoxon == pytest.approx(
        2 / 70
    )  # the one split of 8 runs into 4 and 4 that is as extreme, and its mirror


def test_welchs_p_is_that_of_the_text_books() -> None:
    """Two samples whose t is -2.70782 at 3.17 degrees of freedom, reckoned by hand from Welch's formula."""
    ours, theirs = np.array([1.0, 2, 3, 4]), np.array([6.0, 8, 20, 22])
    variances = ours.var(ddof=1) / 4, theirs.var(ddof=1) / 4
    t = (ours.mean() - theirs.mean()) / np.sqrt(sum(variances))
    freedom = sum(variances) ** 2 / sum(variance**2 / 3 for variance in variances)
    assert compare(ours, theirs).welch == pytest.approx(2 * stats.t.sf(abs(t), freedom))


def test_the_bootstrap_interval_is_that_of_scipy() -> None:
    def difference(x: np.ndarray, y: np.ndarray, axis: int = -1) -> np.ndarray:
        return x.mean(axis=axis) - y.mean(axis=axis)

    theirs = stats.bootstrap((OURS, THEIRS), difference, method="percentile", random_state=np.random.default_rng(1))
    expected = theirs.confidence_interval
    assert interval(OURS, THEIRS) == pytest.approx((expected.low, expected.high), abs=2.0)
    assert interval(OURS, THEIRS) == interval(OURS, THEIRS)


def test_verdicts() -> None:
    assert compare(OURS, THEIRS).verdict(UP) == "holds"
    assert compare(THEIRS, OURS).verdict(UP) == "the other way round"
    assert compare(OURS, OURS + 1).verdict(UP) == "no difference seen"
    assert compare(OURS, OURS + 1).verdict(SAME) == "no difference seen"
    assert compare(OURS, THEIRS).verdict(SAME) == "does not hold"
    assert compare(OURS[:1], THEIRS).verdict(UP) == "too few runs"


def test_runs_without_any_spread_are_compared_too() -> None:
    best = np.full(4, 200.0)
    assert compare(best, best).verdict(SAME) == "no difference seen"
    assert compare(best, best - 1).verdict(UP) == "holds"


def test_the_moving_average_begins_with_what_there_is() -> None:
    assert smooth(np.array([[2.0, 4, 6, 8]]), 2).tolist() == [[2, 3, 5, 7]]


def test_a_goal_is_reached_by_a_whole_window() -> None:
    curve = np.array([[9.0, 0, 5, 5, 5], [0.0, 0, 0, 0, 0]])
    assert reached(curve, 5.0, 2).tolist() == [4, np.inf]
