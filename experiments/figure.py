"""What a figure is: panels of curves, and what the thesis found in them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields, replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

Episodes = list[list[float]]  # of one execution: the step at which each ended, and its return
FOLDER = Path(__file__).resolve().parent / "figures"


class Task(Protocol):
    """How a curve is played: a dataclass whose fields are its settings."""

    episodes: int  # of each execution

    @property
    def advisors(self) -> tuple[str, ...]:
        """The advisors that must have been trained before."""
        ...

    def learn(self, seed: int, saves: Path, on_episode: Callable[[], None]) -> list[Episodes]:
        """One run: what each execution played. `saves`: where the advisors are; `on_episode` is called after each."""
        ...


@dataclass(frozen=True)
class Panel:
    """One pair of axes."""

    title: str
    curves: dict[str, Any]  # name to Task
    window: int = 50  # episodes of the moving average
    goal: float | None = None  # a return; the table tells when it is reached


@dataclass(frozen=True)
class Claim:
    """The thesis: one curve of a panel is above another, between two episodes. `same`: they overlap."""

    panel: str
    better: str
    worse: str
    first: int = 0
    last: int | None = None
    same: bool = False


@dataclass(frozen=True)
class Figure:
    """A figure of the thesis. `runs` per curve, with the seeds 0 to runs - 1."""

    number: str
    title: str
    thesis: str
    panels: tuple[Panel, ...]
    claims: tuple[Claim, ...]
    runs: int = 4

    def panel(self, title: str) -> Panel:
        """By its title."""
        return next(panel for panel in self.panels if panel.title == title)

    def shortened(self, episodes: int | None, runs: int | None) -> Figure:
        """A smaller figure, for a quick look; its claims are about whole runs."""
        smaller = replace(self, runs=runs or self.runs)
        if episodes is None:
            return smaller
        panels = tuple(_shortened(panel, episodes) for panel in self.panels)
        return replace(smaller, panels=panels, claims=tuple(replace(it, first=0, last=None) for it in self.claims))


def _shortened(panel: Panel, episodes: int) -> Panel:
    return replace(panel, curves={name: replace(task, episodes=episodes) for name, task in panel.curves.items()})


def settings_of(task: Any) -> dict[str, Any]:
    """The fields of a task that are not at their defaults, so that a new field leaves old results valid."""
    settings = {"task": type(task).__name__}
    for field in fields(task):
        default = field.default_factory() if field.default_factory is not MISSING else field.default
        if (value := getattr(task, field.name)) != default:
            settings[field.name] = value
    return settings


def numbers() -> list[str]:
    """The figures that there are, e.g. 3.4, in order."""
    names = [path.stem.removeprefix("figure_") for path in FOLDER.glob("figure_*.py")]
    return [f"{chapter}.{number}" for chapter, number in sorted(tuple(map(int, name.split("_"))) for name in names)]


@cache
def figure(number: str) -> Figure:
    """The figure of that number. Raises ModuleNotFoundError."""
    return import_module(f"experiments.figures.figure_{number.replace('.', '_')}").FIGURE
