"""What was played, and what it says: shares of suggestions that were loved, by how probable that was of each."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from experiments.bored.curves import PLAYERS
from experiments.statistics import interval

RESULTS = Path(__file__).resolve().parent.parent / "results" / "bored"
CITY, WEEK = "city", "week"
STUDIES = {CITY: (240, 6.0), WEEK: (20, 1 / 7)}  # visitors, and the weeks in which they come for the first time
LATE = 200  # visitors after so many others


def file_of(study: str, name: str, seed: int) -> Path:
    """Where a run is kept."""
    return RESULTS / study / f"{name.lower().replace(',', '').replace(' ', '-')}-{seed}.json"


def load(study: str, name: str) -> dict[int, np.ndarray]:
    """The runs that there are, by seed: the chance of each suggestion, (V, 30)."""
    files = {seed: file_of(study, name, seed) for seed in range(1, 100)}
    return {seed: _read(file) for seed, file in files.items() if file.exists()}


def _read(file: Path) -> np.ndarray:
    rows = json.loads(file.read_text())["percent"]
    return np.array([[int(row[at : at + 2]) for at in range(0, len(row), 2)] for row in rows]) / 100


def table() -> str:
    """Shares of suggestions that were loved in the city, by player."""
    lines = ["| suggests | runs | all | the very first visitor, 10 | after 200 others, 10 | after 200 others, 30 |"]
    lines.append("|---|---|---|---|---|---|")
    for name in PLAYERS:
        if runs := list(load(CITY, name).values()):
            parts = [
                runs,
                [run[0, :10] for run in runs],
                [run[LATE:, :10] for run in runs],
                [run[LATE:] for run in runs],
            ]
            shares = [np.array([part.mean() for part in each]) for each in parts]
            lines.append(f"| {name} | {len(runs)} | " + " | ".join(map(said, shares)) + " |")
    return "\n".join(lines)


def said(shares: np.ndarray) -> str:
    """A mean, with its interval if there are several."""
    if len(shares) < 2:
        return f"{shares.mean():.3f}"
    low, high = interval(shares)
    return f"{shares.mean():.3f} ({low:.3f} to {high:.3f})"
