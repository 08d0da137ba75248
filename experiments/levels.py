"""Known figures beside ours: the mean return of a curve's last episodes, up to an episode, run by run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from experiments.figure import Figure, Level
from experiments.results import read_curve
from experiments.statistics import areas

HEADER = "| task | learner | known figure | episodes | the mean of these in each of our runs | mean | |"


def level_table(figure: Figure, results: Path) -> list[str]:
    """Lines of Markdown; none where nothing is known."""
    if not figure.levels:
        return []
    return [HEADER, "|---" * 7 + "|", *(_row(figure, level, results) for level in figure.levels), ""]


def say(figure: Figure, level: Level, results: Path) -> str:
    """In words, e.g. 'Cart Pole, PPO: 498 where 475 is known, reached'."""
    ours = means(figure, level, results)
    seen = f"{ours.mean():.0f} where {level.known:g} is known, " if len(ours) else ""
    return f"{level.panel}, {level.curve}, by episode {_last(figure, level)}: {seen}{verdict(level, ours)}"


def means(figure: Figure, level: Level, results: Path) -> np.ndarray:
    """Of the last `over` episodes up to `by`, (runs,)."""
    curve = read_curve(results, figure, figure.panel(level.panel), level.curve)
    last = _last(figure, level)
    return areas(curve, max(0, last - level.over), last) if len(curve) else np.empty(0)


def verdict(level: Level, ours: np.ndarray) -> str:
    """Whether the mean of the runs has reached the figure; and how many of them have, where not all are alike."""
    if not len(ours):
        return "no runs yet"
    there = int((ours >= level.known).sum())
    runs = "" if there in (0, len(ours)) else f" ({there} of {len(ours)} runs)"
    return f"{'reached' if ours.mean() >= level.known else 'not reached'}{runs}"


def learner(task: Any) -> str:
    """The algorithm and what of its parameters is not as usual."""
    changed = ", ".join(f"`{name}` {value}" for name, value in task.parameters.items())
    return f"{task.algorithm}: {changed or 'its defaults'}"


def _row(figure: Figure, level: Level, results: Path) -> str:
    ours = means(figure, level, results)
    cells = [level.panel, learner(figure.panel(level.panel).curves[level.curve])]
    cells += [f"{level.known:g} ({level.source})", _episodes(figure, level)]
    cells += [
        ", ".join(f"{mean:.0f}" for mean in ours),
        f"{ours.mean():.0f}" if len(ours) else "",
        verdict(level, ours),
    ]
    return "| " + " | ".join(cells) + " |"


def _episodes(figure: Figure, level: Level) -> str:
    """Which count, and whether they only try out what was learned."""
    task, last = figure.panel(level.panel).curves[level.curve], _last(figure, level)
    first = max(0, last - level.over)
    tries = first >= task.episodes - getattr(task, "tried", 0)
    return f"{first + 1} to {last}{', not exploring' if tries else ''}"


def _last(figure: Figure, level: Level) -> int:
    return level.by or figure.panel(level.panel).curves[level.curve].episodes
