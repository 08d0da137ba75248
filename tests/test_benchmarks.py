"""What the benchmarks reckon with."""

from __future__ import annotations

import pytest

from benchmarks.crowd import Load
from benchmarks.histories import CASES, Case, History, Log, path_of
from benchmarks.parity_table import compare
from benchmarks.report import Line, Result, table
from benchmarks.rig import EPISODE, Player, Timings
from benchmarks.scaled import crowd, step

CASE = Case("PPO on a game", "PPO", "Game-v0", 100, 4)


def history(value: float) -> History:
    return History([[step, value] for step in range(10, 101, 10)], 1.0)


def compared(ours: list[float], theirs: list[float]) -> Line:
    histories = {
        (CASE.name, "over HTTP"): [history(value) for value in ours],
        (CASE.name, "in process"): [history(value) for value in theirs],
    }
    return compare(CASE, "in process", "over HTTP", histories)[0]


def test_equal_learning_holds():
    assert compared([5, 6, 7, 8], [5, 6, 7, 8]).holds


def test_better_learning_holds():
    assert compared([15, 16, 17, 18], [5, 6, 7, 8]).holds


def test_clearly_worse_learning_fails():
    assert compared([5, 6, 7, 8], [15, 16, 17, 18]).holds is False


def test_an_episode_counts_where_it_ended():
    episodes = [[10, 1.0], [20, 3.0], [40, 5.0], [41, 6.0], [80, 7.0], [81, 8.0], [101, 10.0]]
    histories = {(CASE.name, way): [History(episodes, 1.0)] for way in ("over HTTP", "in process")}
    assert compare(CASE, "in process", "over HTTP", histories)[1]["over HTTP"]["by_fifths"] == [2, 5, 6, 7, 9]


def test_every_history_has_a_file_of_its_own():
    paths = [path_of(case, way, seed) for case in CASES for way in case.ways for seed in range(case.seeds)]
    assert len(set(paths)) == len(paths)


def test_environments_that_share_a_log_count_together():
    log = Log()
    for total in (None, 3.0, None, 7.0):
        log.note(total)
    assert (log.steps, log.episodes) == (4, [[2, 3.0], [4, 7.0]])


def test_timings_know_their_percentiles():
    timings = Timings()
    timings.ms = [float(number) for number in range(101)]
    assert (timings.p50, timings.percentile(99), timings.rate) == (50, 99, pytest.approx(20))


class Session:
    def __init__(self) -> None:
        self.ended: list[bool] = []

    def step(self, obs: object, reward: float, terminated: bool) -> None:
        self.ended.append(terminated)


def test_a_player_counts_the_steps_that_a_learner_counts():
    player = Player(Session())
    for _ in range(2 * EPISODE + 2):
        player.step()
    assert player.session.ended.count(True) == 2
    assert player.outcomes == 2 * EPISODE  # the first messages of the second and third episode have no outcome


def test_a_bar_that_fails_is_seen_in_the_table():
    lines = [Line("stall", "2 s", "0.4 s", False), Line("rate", "9/s", "5/s", True), Line("size", "3")]
    assert table([Result("crowd", lines, {})]).splitlines()[2:] == [
        "| `crowd` | stall | 2 s | 0.4 s | **fails** |",
        "|  | rate | 9/s | 5/s | holds |",
        "|  | size | 3 |  |  |",
    ]


def loads(rate: int, errors: list[str]) -> list[Load]:
    return [Load(calls=rate, seconds=1.0, longest=0.1, errors=errors) for _ in range(2)]


@pytest.mark.parametrize(
    ("scaled", "errors", "holds"), [(700, [], True), (690, [], False), (900, ["Refused: 503"], False)]
)
def test_sixteen_clients_through_redis_are_beside_the_embedded_ones(scaled: int, errors: list[str], holds: bool):
    rate, _ = crowd.lines_of(True, {"embedded": loads(1000, []), "scaled": loads(scaled, errors)})
    assert (rate.holds, rate.measured[:4]) == (holds, f"{scaled / 1000:.2f}")


def test_one_client_through_redis_has_a_bar_for_the_median_and_one_for_the_slowest():
    timings = {name: Timings() for name in ("embedded", "scaled")}
    timings["embedded"].ms, timings["scaled"].ms = [1.0] * 100, [2.0] * 97 + [20.0] * 3
    timed = step.lines(timings)
    assert [(line.bar, line.holds) for line in timed] == [("< 3 ms", True), ("< 15 ms", False), ("", None), ("", None)]
