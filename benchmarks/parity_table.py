"""Whether two ways of learning reach the same reward: means by fifths of the steps, and a permutation test over seeds."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np

from benchmarks.histories import Case, History
from benchmarks.report import Line

PARTS = 5
SIGNIFICANT = 0.05


def compare(
    case: Case, base: str, way: str, histories: dict[tuple[str, str], list[History]]
) -> tuple[Line, dict[str, Any]]:
    """A line of the table, and the figures behind it. The bar holds unless the way is worse by more than chance explains."""
    ours, theirs = histories[case.name, way], histories[case.name, base]
    by_fifths = {name: _fifths(case, some) for name, some in ((way, ours), (base, theirs))}
    finals = {name: [_final(case, history) for history in some] for name, some in ((way, ours), (base, theirs))}
    wholes = {name: [_area(case, history) for history in some] for name, some in ((way, ours), (base, theirs))}
    chance = max(0.0, _chance_of_worse(wholes[way], wholes[base]))
    worse = chance < SIGNIFICANT
    figures = {
        name: {
            "by_fifths": by_fifths[name],
            "mean_return": _spread(wholes[name]),
            "last_fifth": _spread(finals[name]),
            "seeds": len(wholes[name]),
        }
        for name in (way, base)
    }
    text = f"{_row(by_fifths[way])} against {_row(by_fifths[base])}; chance of one so low {chance:.2f}"
    what = f"{case.name}, {way}: mean return by fifths of {case.steps:,} steps, beside {base}, {len(ours)} seeds"
    return Line(what, text, "the same reward at N steps", not worse), figures | {"chance_of_worse": round(chance, 3)}


def _fifths(case: Case, histories: list[History]) -> list[float]:
    """The mean return in each fifth of the steps, over seeds."""
    return [
        round(float(np.mean(part)), 1) for part in zip(*(_parts(case, history) for history in histories), strict=True)
    ]


def _parts(case: Case, history: History) -> list[float]:
    """The mean return of the episodes that ended in each fifth of the steps; an episode counts once, however long."""
    ends, returns = np.array(history.episodes).T
    part = np.minimum((ends - 1) * PARTS // case.steps, PARTS - 1)
    return [float(returns[part == number].mean()) for number in range(PARTS)]


def _area(case: Case, history: History) -> float:
    return float(np.mean(_parts(case, history)))


def _final(case: Case, history: History) -> float:
    return _parts(case, history)[-1]


def _spread(values: list[float]) -> str:
    return f"{np.mean(values):.1f} ± {np.std(values):.1f}"


def _row(values: list[float]) -> str:
    return ", ".join(f"{value:.0f}" for value in values)


def _chance_of_worse(ours: list[float], theirs: list[float]) -> float:
    """How often a random split of all seeds gives a first group whose mean is as low as ours: an exact one-sided test."""
    together = np.array(ours + theirs)
    splits = [list(chosen) for chosen in combinations(range(len(together)), len(ours))]
    return float(np.mean([together[chosen].mean() <= np.mean(ours) + 1e-9 for chosen in splits]))
