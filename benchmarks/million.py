"""The admin page and the learning curve of an agent with a million EpisodeReturns: benchmarks/curve.py, as a row."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

from benchmarks.report import ROOT, Line, Result

BAR_MS = 500
PAGES = {
    "page_ms": "the agent's admin page",
    "curve_ms": "its curve",
    "curve_by_execution_ms": "its curve, a line per execution",
}


def run() -> Result:
    """The row."""
    done = subprocess.run([sys.executable, ROOT / "curve.py"], capture_output=True, text=True, check=True)
    numbers: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    lines = []
    for name, what in PAGES.items():
        worst = numbers[name]["worst"]
        lines.append(Line(f"10⁶ EpisodeReturns: {what}, worst of 5", f"{worst:.0f} ms", "< 500 ms", worst < BAR_MS))
    return Result("million", lines, numbers)
