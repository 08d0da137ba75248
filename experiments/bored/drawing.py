"""The figures of the study: shares of suggestions that were loved, with 95 % bootstrap intervals over the runs."""

from __future__ import annotations

from typing import Any

import numpy as np

from experiments.bored.curves import PLAYERS
from experiments.bored.results import CITY, LATE, RESULTS, STUDIES, load
from experiments.statistics import interval, smooth

WINDOW = 20  # visitors


def draw() -> None:
    """One figure for the city, one for the week of 20 visitors; of what was played."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    for study in STUDIES:
        if not any(load(study, name) for name in PLAYERS):
            continue
        drawing, axes = pyplot.subplots(1, 2, figsize=(11, 4.2), layout="constrained", sharey=True)
        for number, name in enumerate(PLAYERS):
            if runs := list(load(study, name).values()):
                _draw_player(axes, study, np.array(runs), f"{name} ({len(runs)} runs)", f"C{number}")
        axes[0].set_xlabel(f"visitor (mean of the last {WINDOW})" if study == CITY else "visitor")
        axes[1].set_xlabel(
            f"suggestion to a visitor after {LATE} others" if study == CITY else "suggestion to a visitor"
        )
        axes[0].set_ylabel("share that is loved")
        axes[1].legend(fontsize=7, frameon=False, ncols=2)
        drawing.savefig(RESULTS / f"{study}.png", dpi=100)
        pyplot.close(drawing)


def _draw_player(axes: Any, study: str, runs: np.ndarray, label: str, colour: str) -> None:
    """`runs`: (R, V, 30)."""
    visitors = runs.mean(2)
    _draw_curve(axes[0], smooth(visitors, WINDOW) if study == CITY else visitors, label, colour)
    _draw_curve(axes[1], smooth(runs[:, LATE if study == CITY else 0 :].mean(1), 5), label, colour)


def _draw_curve(axis: Any, runs: np.ndarray, label: str, colour: str) -> None:
    """`runs`: (R, N)."""
    where, low_high = np.arange(1, runs.shape[1] + 1), np.array([interval(column) for column in runs.T])
    axis.plot(where, runs.mean(0), color=colour, label=label, lw=1.2)
    axis.fill_between(where, *low_high.T, color=colour, alpha=0.12, lw=0)
    axis.spines[["top", "right"]].set_visible(False)
