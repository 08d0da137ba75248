"""What a figure is: panels of curves, and what the thesis, or somebody else, found in them."""

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
    runs: int | None = None  # where it has not as many as the figure


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
class Level:
    """A known figure: a curve's mean return over `over` episodes, up to episode `by` (None: its last), is at least `known`."""

    panel: str
    curve: str
    known: float
    source: str
    by: int | None = None
    over: int = 100


@dataclass(frozen=True)
class Figure:
    """A figure of the thesis, or of our own. `runs` per curve, with the seeds 0 to runs - 1."""

    number: str  # of the thesis, e.g. 3.4; else a word
    title: str
    thesis: str  # what it, or `said_by`, says
    panels: tuple[Panel, ...]
    claims: tuple[Claim, ...]
    runs: int = 4
    levels: tuple[Level, ...] = ()
    said_by: str = "The thesis"
    remark: str = ""  # ours, below the tables

    def panel(self, title: str) -> Panel:
        """By its title."""
        return next(panel for panel in self.panels if panel.title == title)

    def runs_of(self, panel: Panel) -> int:
        """How many runs each of its curves has."""
        return panel.runs or self.runs

    def shortened(self, episodes: int | None, runs: int | None) -> Figure:
        """A smaller figure, for a quick look; its claims are about whole runs."""
        panels = tuple(replace(it, runs=runs or it.runs) for it in self.panels)
        smaller = replace(self, runs=runs or self.runs, panels=panels)
        if episodes is None:
            return smaller
        panels = tuple(_shortened(panel, episodes) for panel in panels)
        claims = tuple(replace(it, first=0, last=None) for it in self.claims)
        return replace(smaller, panels=panels, claims=claims, levels=tuple(replace(it, by=None) for it in self.levels))


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
    """The figures that there are: those of the thesis in order, e.g. 3.4, then our own, e.g. known."""
    names = [path.stem.removeprefix("figure_") for path in FOLDER.glob("figure_*.py")]
    numbered = sorted(tuple(map(int, name.split("_"))) for name in names if name[0].isdigit())
    ours = sorted(name for name in names if not name[0].isdigit())
    return [f"{chapter}.{number}" for chapter, number in numbered] + ours


@cache
def figure(number: str) -> Figure:
    """The figure of that number. Raises ModuleNotFoundError."""
    return import_module(f"experiments.figures.figure_{number.replace('.', '_')}").FIGURE
