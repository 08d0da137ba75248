"""What a row of the table says, and how it is kept and printed."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent
RESULTS = ROOT / "results"
PAGE = ROOT / "README.md"
BEGIN, END = "<!-- the table begins -->", "<!-- the table ends -->"


@dataclass
class Line:
    """One measured figure beside its bar."""

    what: str
    measured: str
    bar: str = ""
    holds: bool | None = None  # None: there is no bar

    def cells(self) -> list[str]:
        """As the table shows it."""
        return [self.what, self.measured, self.bar, {None: "", True: "holds", False: "**fails**"}[self.holds]]


@dataclass
class Result:
    """What one row measured, where and when."""

    row: str
    lines: list[Line]
    numbers: dict[str, Any]
    setting: dict[str, Any] = field(default_factory=dict)

    def save(self) -> None:
        """Keep it in results/."""
        RESULTS.mkdir(exist_ok=True)
        (RESULTS / f"{self.row}.json").write_text(json.dumps(asdict(self), indent=1) + "\n")


def load(row: str) -> Result | None:
    """What the row measured last; None if it never ran."""
    path = RESULTS / f"{row}.json"
    if not path.exists():
        return None
    data = json.loads(path.read_text())
    return Result(data["row"], [Line(**line) for line in data["lines"]], data["numbers"], data["setting"])


def setting() -> dict[str, Any]:
    """The machine, how busy it is, and the code."""
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True)
    return {
        "at": time.strftime("%Y-%m-%d %H:%M", time.gmtime()),
        "commit": commit.stdout.strip(),
        "cpus": os.cpu_count(),
        "load_before": round(os.getloadavg()[0], 1),
        "python": platform.python_version(),
    }


def table(results: list[Result]) -> str:
    """All rows as one Markdown table."""
    lines = ["| row | what | measured | bar | |", "|---|---|---|---|---|"]
    for result in results:
        first = f"`{result.row}`"
        for line in result.lines:
            lines.append("| " + " | ".join([first, *line.cells()]) + " |")
            first = ""
    return "\n".join(lines)


def sources(results: list[Result]) -> str:
    """When, and on how busy a machine, each row was measured."""
    lines = ["| row | measured at (UTC) | commit | CPUs | load average before and after |", "|---|---|---|---|---|"]
    for result in results:
        it = result.setting
        load = f"{it.get('load_before', '?')}, {it.get('load_after', '?')}"
        lines.append(f"| `{result.row}` | {it.get('at')} | {it.get('commit')} | {it.get('cpus')} | {load} |")
    return "\n".join(lines)


def write_page(results: list[Result]) -> None:
    """Put the table into benchmarks/README.md, between its marks, and into results/table.md."""
    text = f"{table(results)}\n\n{sources(results)}\n"
    (RESULTS / "table.md").write_text(text)
    page = PAGE.read_text()
    before, after = page.split(BEGIN)[0], page.split(END)[1]
    PAGE.write_text(f"{before}{BEGIN}\n{text}{END}{after}")
