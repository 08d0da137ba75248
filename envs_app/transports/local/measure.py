"""What executions use: CPU time and memory, from /proc."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from envs_app.transports.local.fleet_state import Execution, Population

TICKS = os.sysconf("SC_CLK_TCK")
SMOOTHING = 0.3  # of the newest measurement, for what people look at


def cpu_seconds(pid: int) -> float:
    """User and system time of a process, all threads; 0 when it is gone."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / TICKS


def private_bytes(pid: int) -> int:
    """Memory that only this process holds; 0 when it is gone."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0
    return 1024 * sum(int(line.split()[1]) for line in lines if line.startswith(("Private_Clean", "Private_Dirty")))


def update(execution: Execution, elapsed: float) -> float:
    """Measure an execution; returns the CPU seconds it used in the last `elapsed` seconds."""
    total = cpu_seconds(execution.pid)
    used, execution.cpu_seconds = max(0.0, total - execution.cpu_seconds), max(total, execution.cpu_seconds)
    execution.cpu_percent += SMOOTHING * (100 * used / elapsed - execution.cpu_percent)
    steps = execution.status.get("steps", 0)
    per_second = (steps - execution.steps_before) / elapsed
    execution.steps_before = steps
    execution.steps_per_second += SMOOTHING * (per_second - execution.steps_per_second)
    return used


def status_of(execution: Execution, population: Population) -> dict[str, Any]:
    """What the admin shows of an execution (agents_app.fleet.ExecutionStatus)."""
    mates = [e for e in population.by_uid.values() if e.run == execution.run and e is not execution]
    state = execution.state if execution.state != "ready" else ("acting" if execution.active else "waiting")
    return {
        **execution.status,
        "uid": execution.uid,
        "number": execution.number,
        "run": execution.run,
        "agent": execution.agent,
        "pid": execution.pid,
        "state": state,
        "started_at": execution.started,
        "saving": execution.saves_answered < execution.saves_asked,
        "active_sessions": sorted(execution.active),
        "sessions": len(execution.active),
        "steps_per_second": round(execution.steps_per_second, 1),
        "cpu_percent": round(execution.cpu_percent, 1),
        "memory": private_bytes(execution.pid),
        "advises": [mate.number for mate in mates if execution.number in mate.status.get("advisors", [])],
    }
