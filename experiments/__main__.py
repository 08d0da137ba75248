"""`make experiments`: play what is missing, draw it, and write README.md.

python -m experiments                   all figures; interrupted, it goes on where it was
python -m experiments 3.4 --jobs 2      some figures, on two cores
python -m experiments --only-show       draw and write what there is, and play nothing
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from pathlib import Path

from experiments import drawing
from experiments.figure import Figure, figure, numbers
from experiments.page import chapter, write_page
from experiments.results import RESULTS
from experiments.runner import play


def main(arguments: list[str] | None = None) -> int:
    """Play, draw, write. The exit code tells whether anything broke."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if options.results == RESULTS and (options.episodes or options.advisor_steps):
        parser.error("a quick look needs another folder: give --results, too")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # through every `with`: no server is left behind
    chosen = [_smaller(number, options) for number in options.figure or numbers()]
    failed = [] if options.only_show else play(chosen, options.results, options.jobs, options.advisor_steps)
    for each in chosen:
        drawing.draw(each, options.results)
        print(chapter(each, options.results))
    if options.results == RESULTS:
        write_page([figure(number) for number in numbers()], RESULTS)
    print("\n".join(failed), file=sys.stderr)
    return 1 if failed else 0


def _smaller(number: str, options: argparse.Namespace) -> Figure:
    return figure(number).shortened(options.episodes, options.runs)


def _parser() -> argparse.ArgumentParser:
    rows = "".join(f"\n  {number:5} {figure(number).title}" for number in numbers())
    parser = argparse.ArgumentParser(
        "python -m experiments", description=f"Figures:{rows}", formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("figure", nargs="*", choices=[[], *numbers()], help="figures to play; none: all")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="runs at a time (default: %(default)s)")
    parser.add_argument("--runs", type=int, help="runs per curve, if not as many as the figure wants")
    parser.add_argument("--only-show", action="store_true", help="play nothing")
    parser.add_argument("--results", type=Path, default=RESULTS, help="another folder; README.md stays as it is then")
    parser.add_argument("--episodes", type=int, help="of each run, for a quick look; give another folder, too")
    parser.add_argument("--advisor-steps", type=int, help="for which advisors learn at most, for a quick look")
    return parser


if __name__ == "__main__":
    sys.exit(main())
