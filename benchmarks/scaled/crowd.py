"""Sixteen clients on one agent, in both set-ups, which take turns in one run."""

from __future__ import annotations

import statistics
from contextlib import ExitStack
from typing import Any

from benchmarks.crowd import Load, run_clients
from benchmarks.report import Line, Result
from benchmarks.rig import make_agent, wait_until_idle
from benchmarks.scaled.setups import SETUPS

ROUNDS, SECONDS = 2, 10.0


def run() -> Result:
    """The row: all learning, and learning off."""
    with ExitStack() as stack:
        servers = {name: stack.enter_context(running()) for name, running in SETUPS.items()}
        measured = {learning: _in_turns(servers, enable_learning=learning) for learning in (True, False)}
    lines = [line for learning, loads in measured.items() for line in lines_of(learning, loads)]
    names = {True: "learning", False: "learning_off"}
    numbers = {
        names[learning]: {name: [load.summary() for load in found] for name, found in loads.items()}
        for learning, loads in measured.items()
    }
    return Result("scaled.crowd", lines, numbers)


def _in_turns(servers: dict[str, Any], **options: Any) -> dict[str, list[Load]]:
    keys = {name: make_agent(server, **options) for name, server in servers.items()}
    loads: dict[str, list[Load]] = {name: [] for name in servers}
    for _ in range(ROUNDS):
        for name, server in servers.items():
            loads[name].append(run_clients(server, keys[name], "step", SECONDS))
            wait_until_idle(server)  # what is left to learn would slow the other one
    return loads


def lines_of(learning: bool, loads: dict[str, list[Load]]) -> list[Line]:
    """Rates of both, and their ratio."""
    rates = {name: statistics.mean(load.rate for load in found) for name, found in loads.items()}
    ratio = rates["scaled"] / rates["embedded"]
    longest = {name: max(load.longest for load in found) for name, found in loads.items()}
    failed = [error for found in loads.values() for load in found for error in load.errors]
    what = "all learning" if learning else "learning off"
    return [
        Line(
            f"16 clients through Redis, {what}: rate / embedded rate",
            f"{ratio:.2f} ({rates['scaled']:.0f} / {rates['embedded']:.0f})"
            + (f", FAILED: {failed[0]}" if failed else ""),
            "≥ 0.7",
            ratio >= 0.7 and not failed,
        ),
        Line(f"longest stall, {what}", ", ".join(f"{name} {value:.2f} s" for name, value in longest.items())),
    ]
