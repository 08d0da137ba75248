"""One small JSON per run, in results/<figure>/<panel>-<curve>-<seed>.json."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from benchmarks.report import setting
from experiments.figure import Episodes, Figure, Panel, settings_of

RESULTS = Path(__file__).resolve().parent / "results"


def path_of(results: Path, figure: Figure, panel: Panel, curve: str, seed: int) -> Path:
    """Where a run is kept."""
    name = re.sub(r"[^a-z0-9]+", "-", f"{panel.title} {curve}".lower()).strip("-")
    return results / figure.number / f"{name}-{seed}.json"


def write(path: Path, task: Any, seed: int, executions: list[Episodes], seconds: float) -> None:
    """Keep a run; whole or not at all."""
    where = setting()
    run = {"seed": seed, "settings": settings_of(task), "commit": where["commit"], "at": where["at"]}
    run |= {"seconds": round(seconds, 1), "executions": executions}
    _keep(path, run)


def borrow(path: Path, task: Any, seed: int) -> bool:
    """Keep a run of another figure as this one, if one with this seed has the same settings and episodes enough."""
    for other in sorted(path.parent.parent.glob(f"*/*-{seed}.json")):
        longer = replace(task, episodes=_episodes_in(other))
        if other != path and longer.episodes >= task.episodes and read(other, longer) is not None:
            run = json.loads(other.read_text())
            cut = [episodes[: task.episodes] for episodes in run["executions"]]
            _keep(path, run | {"settings": settings_of(task), "executions": cut})
            return True
    return False


def _episodes_in(path: Path) -> int:
    try:
        return int(json.loads(path.read_text())["settings"]["episodes"])
    except (OSError, ValueError, KeyError, TypeError):
        return 0


def _keep(path: Path, run: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    new = path.with_suffix(".new")
    new.write_text(json.dumps(run, separators=(",", ":")) + "\n")
    new.replace(path)


def read(path: Path, task: Any) -> np.ndarray | None:
    """The returns of a run, (executions, episodes). None when there is none, it is broken, or it was of other settings."""
    try:
        run = json.loads(path.read_text())
        returns = np.array([[value for _, value in episodes] for episodes in run["executions"]], float)
        same = run["settings"] == json.loads(json.dumps(settings_of(task)))
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return returns if same and returns.ndim == 2 and returns.shape[1] == task.episodes else None


def read_curve(results: Path, figure: Figure, panel: Panel, curve: str) -> np.ndarray:
    """All runs of a curve so far, (runs, episodes); of several executions their mean."""
    task = panel.curves[curve]
    runs = [read(path_of(results, figure, panel, curve, seed), task) for seed in range(figure.runs_of(panel))]
    means = [run.mean(axis=0) for run in runs if run is not None]
    return np.array(means).reshape(len(means), task.episodes)


def advisor_path(saves: Path, name: str) -> Path:
    """Where a trained advisor is kept (advisors.py)."""
    return saves / f"{name}.npz"


def advisor_return(saves: Path, name: str) -> float | None:
    """What it earns when it acts itself; None when there is none, or a broken one."""
    try:
        with np.load(advisor_path(saves, name), allow_pickle=False) as file:
            return float(json.loads(str(file["note"]))["mean_return"])
    except (OSError, ValueError, KeyError, TypeError, EOFError, BadZipFile):
        return None
