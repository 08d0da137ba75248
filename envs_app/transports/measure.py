"""What executions use: CPU time and memory, from /proc."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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


@dataclass
class Meter:
    """Measures an execution again and again."""

    pid: int
    cpu_seconds: float = 0.0
    cpu_percent: float = 0.0
    steps: int = 0
    steps_per_second: float = 0.0

    def update(self, steps: int, elapsed: float) -> float:
        """`steps` were answered until now; returns the CPU seconds used in the last `elapsed` seconds."""
        total = cpu_seconds(self.pid)
        used, self.cpu_seconds = max(0.0, total - self.cpu_seconds), max(total, self.cpu_seconds)
        self.cpu_percent += SMOOTHING * (100 * used / elapsed - self.cpu_percent)
        self.steps_per_second += SMOOTHING * ((steps - self.steps) / elapsed - self.steps_per_second)
        self.steps = steps
        return used

    def figures(self) -> dict[str, Any]:
        """For the admin."""
        return {
            "pid": self.pid,
            "steps_per_second": round(self.steps_per_second, 1),
            "cpu_percent": round(self.cpu_percent, 1),
            "memory": private_bytes(self.pid),
        }
