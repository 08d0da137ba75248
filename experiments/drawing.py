"""Figures as the thesis draws them: the moving average of the mean over runs, and a band of one standard deviation."""

from __future__ import annotations

from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from experiments.figure import Figure, Panel
from experiments.results import advisor_return, read_curve
from experiments.statistics import smooth

COLUMNS = 3  # panels in a row, at most
COLOURS = ("#777777", "#d95f02", "#1f77b4", "#1b9e77", "#7b3294", "#a6761d")


def path_of(figure: Figure, results: Path) -> Path:
    """Where the drawing is kept."""
    return results / figure.number / "figure.png"


def draw(figure: Figure, results: Path) -> None:
    """Draw what there is so far, if there is anything."""
    panels = [it for it in figure.panels if any(len(read_curve(results, figure, it, name)) for name in it.curves)]
    if not panels:
        return
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    rows = -(-len(panels) // COLUMNS)
    columns = -(-len(panels) // rows)
    size = (4.8 * columns, 3.8 * rows)
    drawing, axes = pyplot.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False)
    for axis, panel in zip_longest(axes.flat, panels):
        _draw_panel(axis, figure, panel, results) if panel else axis.set_axis_off()
    path = path_of(figure, results)
    path.parent.mkdir(parents=True, exist_ok=True)
    drawing.savefig(path, dpi=110)
    pyplot.close(drawing)


def _draw_panel(axis: Any, figure: Figure, panel: Panel, results: Path) -> None:
    for (name, task), colour in zip(panel.curves.items(), COLOURS, strict=False):
        runs = read_curve(results, figure, panel, name)  # (runs, episodes)
        if len(runs):
            _draw_curve(axis, smooth(runs, panel.window), f"{name} ({len(runs)} runs)", colour)
        for advisor in task.advisors:
            _draw_advisor(axis, advisor_return(results / "advisors", advisor))
    for level in (it for it in figure.levels if it.panel == panel.title):
        axis.plot([0, level.by or panel.curves[level.curve].episodes], [level.known] * 2, "k:", lw=1)
    axis.set_title(panel.title, fontsize=10)
    axis.set_xlabel("episode")
    axis.set_ylabel(f"return, mean of {panel.window} episodes")
    if axis.get_legend_handles_labels()[0]:
        axis.legend(fontsize=8, frameon=False)
    axis.spines[["top", "right"]].set_visible(False)


def _draw_curve(axis: Any, runs: np.ndarray, label: str, colour: str) -> None:
    episodes = np.arange(1, runs.shape[1] + 1)
    mean, deviation = runs.mean(axis=0), runs.std(axis=0)
    axis.plot(episodes, mean, color=colour, label=label)
    axis.fill_between(episodes, mean - deviation, mean + deviation, color=colour, alpha=0.18, lw=0)


def _draw_advisor(axis: Any, level: float | None) -> None:
    """A dashed line at what the advisor earns; once."""
    if level is not None and not any(line.get_label() == "the advisor" for line in axis.get_lines()):
        axis.axhline(level, color="black", lw=0.8, ls="--", label="the advisor")
