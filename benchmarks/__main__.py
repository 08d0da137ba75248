"""`make bench`: measure, print the table beside its bars, keep it in results/ and README.md.

python -m benchmarks                 every row but the long ones, which are shown as they were measured last
python -m benchmarks step memory     some rows
python -m benchmarks soak            what grows in ten minutes
python -m benchmarks parity          the learning curves: an hour or two, goes on where it was interrupted
python -m benchmarks --scaled        the rows about the scaled-out set-up (make bench SCALED=1); needs redis-server and PostgreSQL
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from importlib import import_module

from benchmarks import report

ROWS = {
    "step": "a step beside /healthz",
    "training": "steps while PPO trains",
    "crowd": "16 clients on one agent",
    "advice": "what advice adds",
    "added": "what advice adds to a decision, by algorithm",
    "login": "login, and a new execution",
    "memory": "memory of an execution",
    "kill": "kill -9 of an execution",
    "outages": "kill -9 of each part, scaled out",
    "inprocess": "Stable-Baselines3 in process; the original Shepherd",
    "bdpi": "BDPI's ensemble of critics beside a loop",
    "million": "a million EpisodeReturns",
    "soak": "ten minutes of 16 clients",
    "parity": "learning over HTTP and in process",
}
SCALED = {
    "scaled.step": "one client through Redis",
    "scaled.crowd": "16 clients through Redis",
    "scaled.kill": "kill -9 of an execution, scaled out",
    "scaled.growth": "more processes, and more sessions that are mostly idle",
    "scaled.many": "500 live executions",
    "scaled.waiting": "5,000 open sessions on 64 executions",
}
EVERY = ROWS | SCALED
LONG = ("soak", "parity")


def main() -> int:
    """Measure what was asked for; the exit code tells whether anything broke, not whether the bars hold."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # through every `with`: no server is left behind
    rows = "".join(f"\n  {name:15} {text}" for name, text in EVERY.items())
    parser = argparse.ArgumentParser(
        "python -m benchmarks", description=f"Rows:{rows}", formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "row", nargs="*", choices=[[], *EVERY], help="rows to measure; none: all but the long and the scaled ones"
    )
    parser.add_argument("--scaled", action="store_true", help="the rows about the scaled-out set-up")
    asked = parser.parse_args()
    chosen = asked.row or (list(SCALED) if asked.scaled else [row for row in ROWS if row not in LONG])
    for row in chosen:
        measure(row)
    results = [result for row in EVERY if (result := report.load(row))]
    report.write_page(results)
    print(report.table([result for result in results if result.row in (*chosen, *LONG)]))
    return 0


def measure(row: str) -> None:
    """Run one row and keep its result."""
    print(f"{row}: {EVERY[row]} ...", file=sys.stderr, flush=True)
    setting = report.setting()
    result = import_module(f"benchmarks.{row}").run()
    result.setting = setting | {"load_after": round(os.getloadavg()[0], 1)}
    result.save()


if __name__ == "__main__":
    sys.exit(main())
