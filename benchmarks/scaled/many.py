"""500 live executions on one machine: the memory of all processes, Redis and PostgreSQL among them."""

from __future__ import annotations

import psutil

from benchmarks.lean import LeanSession
from benchmarks.memory import private
from benchmarks.report import Line, Result
from benchmarks.rig import OBSERVATIONS, make_agent, step_patiently
from benchmarks.scaled.setups import scaled
from tests.faults.scaled.setup import Scaled

MANY = 500


def run() -> Result:
    """The row: every session is in the middle of an episode, so that each has an execution of its own."""
    with scaled(SHEPHERD_SLOTS=MANY // 2, SHEPHERD_LOGINS=0) as server:
        before = memory(server)
        key = make_agent(server, advice="none")
        for _ in range(MANY):
            step_patiently(LeanSession(server.url, key), OBSERVATIONS[0])
        live, total = server.execution_pids(), memory(server)
        each = sum(private(pid) for pid in live) / len(live)
    line = Line(
        "500 live executions, scaled out: memory of everything",
        f"{total / 1024:.1f} GB with {len(live)} live; {before / 1024:.1f} GB with none; {each:.1f} MB private each",
        "≤ 12 GB",
        total <= 12 * 1024 and len(live) == MANY,
    )
    return Result("scaled.many", [line], {"live": len(live), "mb": total, "mb_before": before, "private_mb": each})


def memory(server: Scaled) -> float:
    """Megabytes of all processes and services; what they share counts once."""
    services = [service.process.pid for service in (server.redis, server.postgres) if service.process]
    below = [
        child for pid in services for child in [psutil.Process(pid), *psutil.Process(pid).children(recursive=True)]
    ]
    return sum(process.memory_full_info().pss for process in [*server.processes(), *below]) / 2**20
