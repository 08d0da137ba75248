"""python -m experiments.bored: play what is missing of the study, then say what was found."""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np
import torch as th

from experiments.bored.city import City
from experiments.bored.curves import PLAYERS
from experiments.statistics import interval

RESULTS = Path(__file__).resolve().parent.parent / "results" / "bored"
VISITORS, WEEKS = 240, 6.0
LATE = 200  # visitors after so many others


def play(name: str, seed: int) -> np.ndarray:
    """One city, from its first visitor to its last: (V, 30) of bool."""
    city = City(VISITORS, WEEKS, seed)
    player = PLAYERS[name](len(city.places), seed)
    for moment in city.moments:
        suggestion = city.suggestion(moment)
        place = player.suggest(suggestion)
        player.hear(suggestion, place, city.answer(suggestion, place))
    player.close()
    return city.loved()


def load(name: str) -> list[np.ndarray]:
    """The runs that there are."""
    files = sorted(RESULTS.glob(f"{slug(name)}-*.json"))
    return [np.array([list(map(int, row)) for row in json.loads(file.read_text())["loved"]], bool) for file in files]


def slug(name: str) -> str:
    """For a file."""
    return name.lower().replace(",", "").replace(" ", "-")


def table() -> str:
    """Shares of suggestions that were loved, by player."""
    lines = ["| suggests | runs | all | the very first visitor, 10 | after 200 others, 10 | after 200 others, 30 |"]
    lines.append("|---|---|---|---|---|---|")
    for name in PLAYERS:
        if runs := load(name):
            shares = [
                [float(run.mean()) for run in runs],
                [float(run[0, :10].mean()) for run in runs],
                [float(run[LATE:, :10].mean()) for run in runs],
                [float(run[LATE:].mean()) for run in runs],
            ]
            lines.append(f"| {name} | {len(runs)} | " + " | ".join(map(said, shares)) + " |")
    return "\n".join(lines)


def said(shares: list[float]) -> str:
    """A mean, with its interval if there are several."""
    if len(shares) < 2:
        return f"{np.mean(shares):.3f}"
    low, high = interval(np.array(shares))
    return f"{np.mean(shares):.3f} ({low:.3f} to {high:.3f})"


def main() -> None:
    """Play and tell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("players", nargs="*", help="a part of their names (default: all)")
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--only-show", action="store_true")
    options = parser.parse_args()
    th.set_num_threads(1)
    RESULTS.mkdir(parents=True, exist_ok=True)
    chosen = [name for name in PLAYERS if not options.players or any(part in name for part in options.players)]
    for seed in range(1, options.seeds + 1):
        for name in [] if options.only_show else chosen:
            file = RESULTS / f"{slug(name)}-{seed}.json"
            if not file.exists():
                started = time.monotonic()
                loved = play(name, seed)
                rows = ["".join(map(str, row.astype(int))) for row in loved]
                file.write_text(json.dumps({"player": name, "seed": seed, "loved": rows}, indent=0) + "\n")
                print(f"{name}, seed {seed}: {loved.mean():.3f} in {time.monotonic() - started:.0f} s", flush=True)
    print(table())


if __name__ == "__main__":
    main()
