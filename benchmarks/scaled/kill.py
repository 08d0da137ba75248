"""From kill -9 of an execution to the next answered step of its session, in both set-ups."""

from __future__ import annotations

import statistics

from benchmarks import kill
from benchmarks.report import Line, Result
from benchmarks.scaled.setups import SETUPS


def run() -> Result:
    """The row."""
    measured = {}
    for name, running in SETUPS.items():
        with running() as server:
            measured[name] = kill.measure(server)
    lines = [
        Line(
            f"kill -9 of an execution to the next answered step, {name}",
            f"median {statistics.median(seconds):.2f} s, longest {max(seconds):.2f} s; repeated at most {max(repeats)} times",
            "< 2 s",
            max(seconds) < 2,
        )
        for name, (seconds, repeats) in measured.items()
    ]
    return Result("scaled.kill", lines, {name: {"seconds": s, "repeats": r} for name, (s, r) in measured.items()})
