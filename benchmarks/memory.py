"""Memory that an execution of a small network adds: fresh, and after it has trained; many of them, extrapolated to 500."""

from __future__ import annotations

import re
import statistics
from pathlib import Path

from benchmarks.lean import LeanSession
from benchmarks.report import Line, Result
from benchmarks.rig import ROLLOUT, make_agent, play, wait_until_idle
from tests.servers import Server, running_server

LIVE, TRAINED = 100, 10
MANY = 500


def run() -> Result:
    """The row."""
    with running_server() as server:
        key = make_agent(server, advice="none")
        before = server_memory(server)
        sessions = [_in_an_episode(server, key) for _ in range(LIVE)]
        fresh = [private(pid) for pid in server.execution_pids()]
        total = server_memory(server)
        for session in sessions[:TRAINED]:
            play(session, ROLLOUT + 99)
        wait_until_idle(server)
        learned = sorted((private(pid) for pid in server.execution_pids()), reverse=True)[:TRAINED]
        numbers = {
            "executions": len(fresh),
            "fresh_private_mb": round(statistics.mean(fresh), 2),
            "trained_private_mb": round(statistics.mean(learned), 2),
            "trained_private_max_mb": round(max(learned), 2),
            "server_before_mb": round(before),
            "server_with_all_mb": round(total),
        }
    each = statistics.mean(learned)
    gigabytes = (before + MANY * each) / 1024
    lines = [
        Line(
            "private memory of an execution, small network, fresh",
            f"{numbers['fresh_private_mb']} MB",
            "≤ 20 MB",
            max(fresh) <= 20,
        ),
        Line(
            "the same after it has trained", f"{each:.1f} MB, most {max(learned):.1f} MB", "≤ 20 MB", max(learned) <= 20
        ),
        Line(
            "500 live executions",
            f"{gigabytes:.1f} GB, reckoned from {len(fresh)} live ones: {before:.0f} MB before, {total:.0f} MB with them",
            "≤ 12 GB",
            gigabytes <= 12,
        ),
    ]
    return Result("memory", lines, numbers)


def private(pid: int) -> float:
    """Megabytes that only this process has."""
    rollup = Path(f"/proc/{pid}/smaps_rollup").read_text()
    return sum(int(kb) for kb in re.findall(r"^Private_(?:Clean|Dirty):\s+(\d+) kB", rollup, re.M)) / 1024


def server_memory(server: Server) -> float:
    """Megabytes of all processes of the server; what they share counts once."""
    return sum(process.memory_full_info().pss for process in server.processes()) / 2**20


def _in_an_episode(server: Server, key: str) -> LeanSession:
    session = LeanSession(server.url, key)
    session.step([0.0] * 8)
    return session
