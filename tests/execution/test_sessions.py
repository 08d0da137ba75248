"""Many sessions on one execution: the learner gets pieces of their episodes, one after the other, never mixed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents_app.algorithms.replay import Decision
from envs_app.execution import desk
from tests.execution.station import Station


def watch(station: Station) -> list[Any]:
    """Everything that the desk gives to the learner from now on, in order; it gets it too."""
    seen: list[Any] = []
    put = station.worker.feed.put
    station.worker.feed.put = lambda items: (seen.extend(items), put(items))
    return seen


def segments(items: list[Any]) -> list[list[Any]]:
    """What is on the tape, cut where a segment begins."""
    cut: list[list[Any]] = []
    for item in items:
        if isinstance(item, Decision):
            cut.append([])
        cut[-1].append(item)
    return cut


def assert_whole(items: list[Any]) -> None:
    """Each segment is of one session, its outcomes follow each other, and only the last one ends it."""
    for first, *outcomes in segments(items):
        decision = first
        for outcome in outcomes[:-1]:
            assert not (outcome.terminated or outcome.truncated)
            assert outcome.next.obs[0] == decision.obs[0], "two sessions are mixed"
            assert np.array_equal(outcome.obs, outcome.next.obs)
            decision = outcome.next
        assert outcomes[-1].terminated != outcomes[-1].truncated
        assert outcomes[-1].next is None


def place(session: int) -> np.ndarray:
    """An observation that says whose it is."""
    return np.array([session / 10, *np.random.uniform(-1, 1, 2)], np.float32)


@pytest.mark.parametrize("algorithm", ["PPO", "DQN", "RecurrentPPO"])
def test_three_sessions_are_learned_from_in_turn(tmp_path: Path, algorithm: str) -> None:
    with Station(tmp_path, algorithm=algorithm, sessions=3) as station:
        items = watch(station)
        for number in range(60):
            for session in (1, 2, 3):
                ends = number % (5 + session) == 4 + session  # at different times
                station.step(session, place(session), reward=1.0, terminated=ends)
        assert_whole(items)
        station.wait_until(lambda: station.worker.feed.backlog == 0)
        assert station.algorithm._n_updates > 0


def test_each_session_has_its_own_return(tmp_path: Path) -> None:
    with Station(tmp_path, sessions=3) as station:
        for session in (1, 2, 3):
            station.step(session)
        for _ in range(4):
            for session in (1, 2, 3):
                station.step(session, reward=float(session))
        returns = [station.step(session, terminated=True)["episode"]["return"] for session in (1, 2, 3)]
        assert returns == [4.0, 8.0, 12.0]


def test_a_fourth_session_finds_no_place(tmp_path: Path) -> None:
    with Station(tmp_path, sessions=3) as station:
        assert [station.step(session)["k"] for session in (1, 2, 3)] == ["answer"] * 3
        assert station.step(4)["code"] == "busy"


def test_long_episodes_are_cut_and_the_pieces_are_truncated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(desk, "PIECE", 5)
    with Station(tmp_path, sessions=2) as station:
        items = watch(station)
        for _ in range(13):
            station.step(1, place(1), reward=1.0)
        assert station.step(1, place(1), reward=1.0, terminated=True)["episode"]["length"] == 13
        assert_whole(items)
        ends = [piece[-1] for piece in segments(items)]
        assert [(end.terminated, end.truncated) for end in ends] == [(False, True), (False, True), (True, False)]
        assert [len(piece) - 1 for piece in segments(items)] == [5, 5, 3]
        assert np.array_equal(segments(items)[1][0].obs, ends[0].obs), "the next piece begins where the last one ended"


def test_more_sessions_may_be_let_in_while_an_episode_runs(tmp_path: Path) -> None:
    with Station(tmp_path, sessions=1) as station:
        items = watch(station)
        for _ in range(4):
            station.step(1, place(1))
        station.desk.set_sessions(2)
        for _ in range(4):
            station.step(1, place(1))
            station.step(2, place(2))
        for session in (2, 1):
            station.step(session, place(session), terminated=True)
        assert_whole(items)
        assert len(segments(items)) == 3


def test_fewer_sessions_may_be_let_in_while_episodes_run(tmp_path: Path) -> None:
    with Station(tmp_path, sessions=3) as station:
        items = watch(station)
        for _ in range(3):
            for session in (1, 2, 3):
                station.step(session, place(session))
        station.desk.set_sessions(1)
        assert {report["session"] for report in station.told("released")} == {2, 3}
        assert [station.step(session, place(session)).get("code") for session in (1, 2, 3)] == [None, "busy", "busy"]
        station.step(1, place(1), terminated=True)
        assert_whole(items)


def test_an_algorithm_that_plays_itself_keeps_to_one_session(tmp_path: Path) -> None:
    with Station(tmp_path, algorithm="ARS") as station:
        station.desk.set_sessions(8)
        station.step(1)
        assert station.step(2)["code"] == "busy"
