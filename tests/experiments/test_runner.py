"""The runner plays what is missing, and only that."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from experiments import drawing, levels, page
from experiments.figure import Claim, Episodes, Figure, Level, Panel, settings_of
from experiments.results import borrow, read_curve
from experiments.runner import missing, play


@dataclass(frozen=True)
class Counting:
    """A task that learns nothing: its returns are its height and the number of the episode."""

    episodes: int
    height: float = 0.0
    fails: bool = False
    tried: int = 0
    algorithm: str = "Counting"
    parameters: dict[str, int] = field(default_factory=dict)

    @property
    def advisors(self) -> tuple[str, ...]:
        return ()

    def learn(self, seed: int, saves: Path, on_episode: Callable[[], None]) -> list[Episodes]:
        if self.fails:
            raise ValueError("it was to fail")
        return [[[10 * n, self.height + n + seed + execution] for n in range(self.episodes)] for execution in (0, 2)]


LOW_AND_HIGH = {"low": Counting(5), "high": Counting(5, 50.0)}
FIGURE = Figure(
    "9.9",
    "counting",
    "high is higher.",
    (Panel("A panel", LOW_AND_HIGH, 2, 40),),
    (Claim("A panel", "high", "low"),),
    3,
)


def files(results: Path) -> dict[str, tuple[int, str]]:
    return {path.name: (path.stat().st_mtime_ns, path.read_text()) for path in (results / "9.9").glob("*.json")}


def play_here(results: Path) -> None:
    """Play what is missing without the processes of `play`, each of which takes seconds to begin."""
    for job in missing([FIGURE], results):
        job.run()


def test_a_run_is_kept_as_json(tmp_path: Path) -> None:
    assert play([FIGURE], tmp_path, 2) == []
    assert sorted(files(tmp_path)) == sorted(
        f"a-panel-{name}-{seed}.json" for name in LOW_AND_HIGH for seed in range(3)
    )
    run = json.loads((tmp_path / "9.9" / "a-panel-high-1.json").read_text())
    assert run["executions"][0] == [[0, 51], [10, 52], [20, 53], [30, 54], [40, 55]]
    assert (run["seed"], run["settings"]) == (1, {"task": "Counting", "episodes": 5, "height": 50.0})
    assert run["commit"]


def test_a_run_that_is_there_is_not_played_again(tmp_path: Path) -> None:
    play_here(tmp_path)
    before = files(tmp_path)
    (tmp_path / "9.9" / "a-panel-low-2.json").unlink()
    assert len(missing([FIGURE], tmp_path)) == 1
    play([FIGURE], tmp_path, 1)
    again = files(tmp_path)
    assert before.keys() == again.keys()
    assert [name for name in before if before[name] != again[name]] == ["a-panel-low-2.json"]


@pytest.mark.parametrize(
    "wrong",
    ["", "{", "[]", '{"seed": 0}', '{"executions": [[[1, 2.0]]], "settings": {"task": "Counting", "episodes": 5}}'],
)
def test_a_broken_result_is_played_again(tmp_path: Path, wrong: str) -> None:
    play_here(tmp_path)
    path = tmp_path / "9.9" / "a-panel-low-0.json"
    whole = path.read_text()
    path.write_text(wrong)
    assert [job.path for job in missing([FIGURE], tmp_path)] == [path]
    play_here(tmp_path)
    assert json.loads(path.read_text())["executions"] == json.loads(whole)["executions"]


def test_a_run_of_other_settings_is_played_again(tmp_path: Path) -> None:
    play_here(tmp_path)
    panel = Panel("A panel", LOW_AND_HIGH | {"high": Counting(5, 60.0)})
    assert {job.path.name for job in missing([replace(FIGURE, panels=(panel,))], tmp_path)} == {
        f"a-panel-high-{seed}.json" for seed in range(3)
    }


def test_a_curve_of_two_figures_is_played_once(tmp_path: Path) -> None:
    play_here(tmp_path)
    before = json.loads((tmp_path / "9.9" / "a-panel-low-1.json").read_text())
    shorter = {"other": Counting(3), "else": Counting(3, 60.0), "longer": Counting(6)}
    panel = Panel("B", shorter)
    for job in missing([replace(FIGURE, number="8.8", panels=(panel,))], tmp_path):
        assert borrow(job.path, job.task, job.seed) is (job.task == shorter["other"])
    run = json.loads((tmp_path / "8.8" / "b-other-1.json").read_text())
    assert run["executions"] == [episodes[:3] for episodes in before["executions"]]
    assert (run["commit"], run["settings"]) == (before["commit"], {"task": "Counting", "episodes": 3})


def test_settings_leave_out_what_is_as_usual() -> None:
    assert settings_of(Counting(5)) == {"task": "Counting", "episodes": 5}


def test_the_first_seed_of_every_curve_comes_first(tmp_path: Path) -> None:
    assert [job.seed for job in missing([FIGURE], tmp_path)] == [0, 0, 1, 1, 2, 2]


def test_what_fails_is_told_and_the_rest_is_played(tmp_path: Path) -> None:
    panel = Panel("A panel", LOW_AND_HIGH | {"high": Counting(5, fails=True)})
    failed = play([replace(FIGURE, panels=(panel,), runs=1)], tmp_path, 1)
    assert len(failed) == 1
    assert "ValueError: it was to fail" in failed[0]
    assert list(files(tmp_path)) == ["a-panel-low-0.json"]


def test_a_curve_is_the_mean_of_its_executions(tmp_path: Path) -> None:
    play_here(tmp_path)
    assert read_curve(tmp_path, FIGURE, FIGURE.panels[0], "low").tolist() == [
        [seed + 1.0 + n for n in range(5)] for seed in range(3)
    ]


def test_the_page_says_what_was_found(tmp_path: Path) -> None:
    readme = tmp_path / "README.md"
    readme.write_text(f"before\n{page.BEGIN}\nof yesterday\n{page.END}\nafter\n")
    page.write_page([FIGURE], tmp_path, readme)
    assert "We: no runs yet." in readme.read_text()
    play([FIGURE], tmp_path, 2)
    drawing.draw(FIGURE, tmp_path)
    page.write_page([FIGURE], tmp_path, readme)
    text = readme.read_text()
    assert text.startswith("before\n") and text.endswith("\nafter\n") and "yesterday" not in text
    assert "![figure 9.9](9.9/figure.png)" in text
    assert (tmp_path / "9.9" / "figure.png").read_bytes().startswith(b"\x89PNG")
    assert "The thesis: high is higher. We: A panel, high above low: holds (+50, p = " in text
    assert "(3 of 3 runs per curve so far)" in text
    assert "| A panel | high | 3 | 54.0 (53.0 to 55.0) | 56.0 | 40: episode 2 (3 of 3) |" in text
    assert "| A panel | low | 3 | 4.0 (3.0 to 5.0) | 6.0 | 40: not by most (0 of 3) |" in text


def test_known_figures_are_compared_with_the_last_episodes_of_each_run(tmp_path: Path) -> None:
    panel = replace(FIGURE.panels[0], runs=2)
    high = [Level("A panel", "high", known, "somebody", by, 2) for known, by in ((54, None), (55, 5), (60, 3))]
    figure = replace(FIGURE, panels=(panel,), claims=(), levels=(*high, Level("A panel", "low", 1, "nobody")))
    for job in missing([figure], tmp_path):
        job.run() if job.task.height else None
    table = levels.level_table(figure, tmp_path)
    assert table[2] == "| A panel | Counting: its defaults | 54 (somebody) | 4 to 5 | 54, 56 | 55 | reached |"
    assert table[3].endswith("| 4 to 5 | 54, 56 | 55 | reached (1 of 2 runs) |")
    assert table[4].endswith("| 2 to 3 | 52, 54 | 53 | not reached |")
    assert table[5].endswith("|  |  | no runs yet |")
    text = page.chapter(figure, tmp_path)
    assert "We: A panel, high, by episode 5: 55 where 54 is known, reached; " in text
    assert "(0 to 2 of 2 runs per curve so far)" in text and "claim" not in text


def test_of_episodes_that_only_try_out_what_was_learned_the_table_says_so(tmp_path: Path) -> None:
    panel = Panel("A panel", {"high": Counting(5, 50.0, tried=2)}, 2)
    known = tuple(Level("A panel", "high", 54, "somebody", over=over) for over in (2, 3))
    _, _, all_tried, partly, *_ = levels.level_table(
        replace(FIGURE, panels=(panel,), claims=(), levels=known), tmp_path
    )
    assert "| 4 to 5, not exploring |" in all_tried and "| 3 to 5 |" in partly


def test_a_page_without_all_runs_says_how_many_there_are(tmp_path: Path) -> None:
    play_here(tmp_path)
    (tmp_path / "9.9" / "a-panel-low-2.json").unlink()
    assert "(2 to 3 of 3 runs per curve so far)" in page.found(FIGURE, tmp_path)
