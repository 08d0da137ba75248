"""Learning over HTTP beside stock Stable-Baselines3 in process: the same parameters, seeds and environments.

Each history (case, way, seed) is kept in results/parity/ as soon as it is whole, so an interrupted run goes on where it was.
The environment is wrapped by the same recorder in both ways; over HTTP the Python package's own loop plays it.
"""

from __future__ import annotations

import sys
import time
from typing import Any

from benchmarks.histories import ALONE, CASES, ENVIRONMENTS, PARALLEL, Case, History, path_of, read, write
from benchmarks.parity_figure import draw
from benchmarks.parity_table import compare
from benchmarks.report import Line, Result, setting


def run() -> Result:
    """The row: play what is missing, then compare."""
    for case in CASES:
        for seed in range(case.seeds):
            for way in case.ways:
                if not path_of(case, way, seed).exists():
                    _play(case, way, seed)
    histories = {(case.name, way): read(case, way) for case in CASES for way in case.ways}
    draw(histories)
    lines: list[Line] = []
    numbers: dict[str, Any] = {}
    for case in CASES:
        for base, way in case.pairs:
            line, figures = compare(case, base, way, histories)
            lines.append(line)
            numbers[f"{case.name}: {way} beside {base}"] = figures
    return Result("parity", lines, numbers)


def _play(case: Case, way: str, seed: int) -> None:
    """One history, in the way that is asked for."""
    start = time.monotonic()
    learn = _in_process if way in (ALONE, PARALLEL) else _over_http
    episodes = learn(case, seed, ENVIRONMENTS[way])
    seconds = time.monotonic() - start
    write(case, way, seed, History(episodes, round(seconds, 1), setting()["commit"]))
    print(f"{case.name}, {way}, seed {seed}: {len(episodes)} episodes in {seconds:.0f} s", file=sys.stderr, flush=True)


def _in_process(case: Case, seed: int, environments: int) -> list[list[float]]:
    from benchmarks.stock import learn

    return learn(case, seed, environments)


def _over_http(case: Case, seed: int, clients: int) -> list[list[float]]:
    from benchmarks.remote import learn

    return learn(case, seed, clients)
