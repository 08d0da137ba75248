"""The figure of parity: mean return over steps, a panel per case, a band of one standard deviation over seeds."""

from __future__ import annotations

import numpy as np

from benchmarks.histories import CASES, Case, History
from benchmarks.report import RESULTS

WINDOW = 20  # episodes of the moving average
POINTS = 200
COLOURS = {
    "in process": "#777777",
    "over HTTP": "#1f77b4",
    "4 clients": "#d95f02",
    "in process with 4 environments": "#bbbbbb",
}
NAMES = {
    "in process": "Stable-Baselines3 in process",
    "over HTTP": "over HTTP, 1 client",
    "4 clients": "over HTTP, 4 clients share one execution",
    "in process with 4 environments": "Stable-Baselines3 in process, 4 environments",
}


def draw(histories: dict[tuple[str, str], list[History]]) -> None:
    """Write results/parity.png."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, len(CASES), figsize=(4.6 * len(CASES), 3.6), layout="constrained")
    for axis, case in zip(np.atleast_1d(axes), CASES, strict=True):
        for way in case.ways:
            if some := histories[case.name, way]:
                _draw_way(axis, case, way, some)
        axis.set_title(f"{case.name}, {case.seeds} seeds")
        axis.set_xlabel("steps")
        axis.set_ylabel(f"return, mean of {WINDOW} episodes")
        axis.legend(fontsize=8, loc="best", frameon=False)
        axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(RESULTS / "parity.png", dpi=110)
    pyplot.close(figure)


def _draw_way(axis: object, case: Case, way: str, histories: list[History]) -> None:
    steps = np.linspace(case.steps / POINTS, case.steps, POINTS)
    curves = np.array([_curve(history, steps) for history in histories])  # (seeds, POINTS)
    mean, deviation = np.nanmean(curves, axis=0), np.nanstd(curves, axis=0)
    axis.plot(steps, mean, color=COLOURS[way], label=NAMES[way])  # type: ignore[attr-defined]
    axis.fill_between(steps, mean - deviation, mean + deviation, color=COLOURS[way], alpha=0.18, lw=0)  # type: ignore[attr-defined]


def _curve(history: History, steps: np.ndarray) -> np.ndarray:
    """The mean return of the last episodes that had ended at each step; NaN before the first one."""
    ends = np.array([end for end, _ in history.episodes])
    sums = np.concatenate([[0.0], np.cumsum([value for _, value in history.episodes])])
    last = np.searchsorted(ends, steps, side="right")
    first = np.maximum(last - WINDOW, 0)
    return np.where(last > 0, (sums[last] - sums[first]) / np.maximum(last - first, 1), np.nan)
