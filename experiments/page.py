"""README.md: each figure, what the thesis found, what we found. All of it is written from the results and the figures' files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from experiments import drawing
from experiments.figure import Claim, Figure, Panel
from experiments.levels import level_table, say
from experiments.results import read_curve
from experiments.statistics import Comparison, areas, compare, interval, reached

PAGE = Path(__file__).resolve().parent / "README.md"
BEGIN, END = "<!-- the figures begin -->", "<!-- the figures end -->"


def write_page(figures: list[Figure], results: Path, page: Path = PAGE) -> None:
    """Put the figures into the page, between its marks."""
    text = page.read_text()
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    chapters = "\n".join(chapter(figure, results, page) for figure in figures)
    page.write_text(f"{before}{BEGIN}\n{chapters}{END}{after}")


def chapter(figure: Figure, results: Path, page: Path = PAGE) -> str:
    """A figure with its line and its tables."""
    lines = [f"## {figure.number}: {figure.title}", ""]
    path = drawing.path_of(figure, results)
    if path.exists() and path.is_relative_to(page.parent):
        lines += [f"![figure {figure.number}]({path.relative_to(page.parent)})", ""]
    lines += [f"{figure.said_by}: {figure.thesis} We: {found(figure, results)}", ""]
    lines += [*level_table(figure, results), table(figure, results), ""]
    lines += [figure.remark, ""] if figure.remark else []
    return "\n".join(lines)


def found(figure: Figure, results: Path) -> str:
    """What our runs say of each claim and of each known figure, in one line."""
    counts = [len(runs) for panel in figure.panels for runs in _curves(figure, panel, results).values()]
    if not any(counts):
        return "no runs yet."
    wanted = _span([figure.runs_of(panel) for panel in figure.panels])
    seen = [(claim, _compare(figure, claim, results)) for claim in figure.claims]
    said = [_say(claim, comparison) for claim, comparison in seen if comparison.enough]
    said += [say(figure, level, results) for level in figure.levels]
    if lacking := sum(not comparison.enough for _, comparison in seen):
        said += [f"of {lacking} other claims there are too few runs"]
    return f"{'; '.join(said)} ({_span(counts)} of {wanted} runs per curve so far)."


def _span(numbers: list[int]) -> str:
    low, high = min(numbers), max(numbers)
    return f"{low}" if low == high else f"{low} to {high}"


def table(figure: Figure, results: Path) -> str:
    """Areas under the curves, and the comparisons of the claims."""
    lines = [
        "| panel | curve | runs | mean return (area / episodes), 95 % | last fifth | goal reached |",
        "|---" * 6 + "|",
    ]
    for panel in figure.panels:
        lines += [_row(panel, name, runs) for name, runs in _curves(figure, panel, results).items()]
    if not figure.claims:
        return "\n".join(lines)
    lines += ["", "| claim | episodes | difference, 95 % | p (Welch) | p (Wilcoxon) | |", "|---" * 6 + "|"]
    return "\n".join([*lines, *(_claim_row(figure, claim, results) for claim in figure.claims)])


def _curves(figure: Figure, panel: Panel, results: Path) -> dict[str, np.ndarray]:
    return {name: read_curve(results, figure, panel, name) for name in panel.curves}


def _row(panel: Panel, name: str, runs: np.ndarray) -> str:
    cells = [panel.title, name, str(len(runs))]
    if len(runs):
        whole, late = areas(runs), areas(runs, -max(1, runs.shape[1] // 5))
        low, high = interval(whole)
        cells += [f"{whole.mean():.1f} ({low:.1f} to {high:.1f})", f"{late.mean():.1f}", _reached(panel, runs)]
    else:
        cells += ["", "", ""]
    return "| " + " | ".join(cells) + " |"


def _reached(panel: Panel, runs: np.ndarray) -> str:
    """The median episode at which a mean of the goal was reached, and by how many runs."""
    if panel.goal is None:
        return ""
    when = reached(runs, panel.goal, panel.window)
    median = np.median(when)
    text = f"episode {median:.0f}" if np.isfinite(median) else "not by most"
    return f"{panel.goal:.0f}: {text} ({np.isfinite(when).sum()} of {len(when)})"


def _compare(figure: Figure, claim: Claim, results: Path) -> Comparison:
    curves = _curves(figure, figure.panel(claim.panel), results)
    return compare(*(areas(curves[name], claim.first, claim.last) for name in (claim.better, claim.worse)))


def _say(claim: Claim, seen: Comparison) -> str:
    when = f", episodes {_episodes(claim)}" if claim.last or claim.first else ""
    text = f"{claim.panel}, {claim.better} {'as' if claim.same else 'above'} {claim.worse}{when}: {seen.verdict(claim)}"
    return f"{text} ({seen.difference:+.0f}, p = {seen.welch:.2g})"


def _episodes(claim: Claim) -> str:
    return f"{claim.first} to {claim.last or 'the last'}"


def _claim_row(figure: Figure, claim: Claim, results: Path) -> str:
    seen = _compare(figure, claim, results)
    episodes = _episodes(claim) if claim.last or claim.first else "all"
    cells = [f"{claim.panel}: {claim.better} {'=' if claim.same else '>'} {claim.worse}", episodes]
    if seen.enough:
        cells += [f"{seen.difference:+.1f} ({seen.low:.1f} to {seen.high:.1f})"]
        cells += [f"{seen.welch:.2g}", f"{seen.wilcoxon:.2g}"]
    else:
        cells += ["", "", ""]
    return "| " + " | ".join([*cells, seen.verdict(claim)]) + " |"
