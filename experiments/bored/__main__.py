"""python -m experiments.bored: play what is missing of the study, then say and draw what was found."""

from __future__ import annotations

import argparse
import json
import time
import warnings

import numpy as np
import torch as th

from experiments.bored.city import City
from experiments.bored.curves import PLAYERS
from experiments.bored.drawing import draw
from experiments.bored.results import STUDIES, file_of, table


def play(study: str, name: str, seed: int) -> np.ndarray:
    """One city, from its first visitor to its last: how probable it was that each suggestion would be loved, (V, 30)."""
    city = City(*STUDIES[study], seed)
    player = PLAYERS[name](len(city.places), seed)
    for moment in city.moments:
        suggestion = city.suggestion(moment)
        place = player.suggest(suggestion)
        player.hear(suggestion, place, city.answer(suggestion, place))
    player.close()
    return city.chances()


def run(study: str, name: str, seed: int) -> None:
    """Play, and keep it: a row of text per visitor, two digits per suggestion, its chance in percent."""
    started = time.monotonic()
    chances = play(study, name, seed)
    rows = ["".join(f"{percent:02d}" for percent in row) for row in (100 * chances).round().clip(0, 99).astype(int)]
    file = file_of(study, name, seed)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps({"player": name, "seed": seed, "percent": rows}, indent=0) + "\n")
    seconds = time.monotonic() - started
    print(f"{study}, {name}, seed {seed}: {chances.mean():.3f} in {seconds:.0f} s", flush=True)


def main() -> None:
    """Play and tell."""
    parser = argparse.ArgumentParser("python -m experiments.bored", description=__doc__)
    parser.add_argument("players", nargs="*", help="their names (default: all)")
    parser.add_argument("--study", choices=STUDIES, help="one of them (default: all)")
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--only-show", action="store_true")
    options = parser.parse_args()
    th.set_num_threads(1)
    warnings.simplefilter("ignore", UserWarning)  # of torch: arrays that cannot be written to
    for seed in range(1, 1 if options.only_show else options.seeds + 1):
        for study in [options.study] if options.study else STUDIES:
            for name in options.players or PLAYERS:
                if not file_of(study, name, seed).exists():
                    run(study, name, seed)
    print(table())
    draw()


if __name__ == "__main__":
    main()
