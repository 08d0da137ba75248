"""One-step episodes of people who think: late answers find their decision, silence ends it, and nobody waits for anybody."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents_app.algorithms.replay import Outcome
from tests.execution.station import Station
from tests.execution.test_sessions import place, segments, watch

VISITORS = 200


def station(tmp_path: Path, **options: Any) -> Station:
    """An execution that many visitors share."""
    return Station(tmp_path, sessions=300, **options)


def silent(station: Station, session: int, seconds: float) -> None:
    """As if the session had been silent for so long."""
    station.desk.tracks[session].used_at = time.monotonic() - seconds


def test_hundreds_think_at_once_and_each_answer_finds_its_own_decision(tmp_path: Path) -> None:
    with station(tmp_path, algorithm="PPO") as shared:
        items = watch(shared)
        shown = {visitor: place(visitor) for visitor in range(VISITORS)}
        actions = {visitor: shared.step(visitor, obs)["action"] for visitor, obs in shown.items()}
        for visitor in np.random.default_rng(1).permutation(VISITORS).tolist():
            shared.step(visitor, shown[visitor], reward=float(visitor), terminated=True)
        assert len(segments(items)) == VISITORS
        for decision, outcome in segments(items):
            visitor = int(outcome.reward)
            assert np.array_equal(decision.obs, shown[visitor])
            assert decision.action == actions[visitor]


def test_silence_ends_an_episode_with_the_stated_reward(tmp_path: Path) -> None:
    with station(tmp_path, algorithm="PPO", answer_within=60.0, unanswered_reward=-0.5) as shared:
        items = watch(shared)
        shared.step(1, place(1))
        shared.step(2, place(2))
        silent(shared, 1, 61)
        shared.desk.end_unanswered()
        ((decision, outcome),) = segments(items)
        assert np.array_equal(decision.obs[0], place(1)[0])
        assert (outcome.reward, outcome.terminated, outcome.truncated) == (-0.5, True, False)
        assert list(shared.desk.tracks) == [2]
        assert [report["session"] for report in shared.told("released")] == [1]


def test_an_answer_that_comes_after_all_counts_in_the_curve_and_is_not_learned_from_twice(tmp_path: Path) -> None:
    with station(tmp_path, algorithm="PPO", answer_within=60.0) as shared:
        items = watch(shared)
        shared.step(1, place(1))
        silent(shared, 1, 61)
        shared.desk.end_unanswered()
        reply = shared.step(1, place(1), reward=1.0, terminated=True)
        assert (reply["episode"]["return"], reply["episode"]["length"]) == (1.0, 1)
        assert shared.step(1, place(1))["action"] is not None
        assert shared.step(1, place(1), reward=1.0, terminated=True)["episode"]["number"] == 2
        assert [outcomes[-1].reward for _, *outcomes in segments(items)] == [0.0, 1.0]


def test_an_episode_that_goes_on_after_a_silence_is_learned_from_in_two_parts(tmp_path: Path) -> None:
    with Station(tmp_path, algorithm="DQN", answer_within=60.0) as alone:
        items = watch(alone)
        alone.step(1, place(1))
        alone.step(1, place(1), reward=1.0)
        silent(alone, 1, 61)
        alone.desk.end_unanswered()
        alone.step(1, place(1), reward=1.0)
        assert alone.step(1, place(1), reward=1.0, terminated=True)["episode"]["return"] == 3.0
        rewards = [[item.reward for item in part if isinstance(item, Outcome)] for part in segments(items)]
        assert rewards == [[1.0, 0.0], [1.0]]


def test_without_a_limit_a_person_may_take_as_long_as_they_like(tmp_path: Path) -> None:
    with station(tmp_path, algorithm="PPO") as shared:
        items = watch(shared)
        shared.step(1, place(1))
        silent(shared, 1, 1e6)
        shared.desk.end_unanswered()
        shared.step(1, place(1), reward=1.0, terminated=True)
        assert [outcomes[-1].reward for _, *outcomes in segments(items)] == [1.0]


def test_what_a_silent_session_did_is_learned_from_and_its_last_action_waits_for_its_outcome(tmp_path: Path) -> None:
    with station(tmp_path, algorithm="DQN") as shared:
        items, shown = watch(shared), [place(1) for _ in range(4)]
        for step, obs in enumerate(shown):
            shared.step(1, obs, reward=float(step))
            shared.step(2, place(2))
        silent(shared, 1, 121)
        shared.desk.end_unanswered()
        ((decision, *outcomes),) = segments(items)
        assert np.array_equal(decision.obs, shown[0])
        assert [(it.reward, it.truncated, it.next is None) for it in outcomes] == [
            (1.0, False, False),
            (2.0, False, False),
            (3.0, True, True),
        ]
        shared.desk.end_unanswered()
        assert len(segments(items)) == 1, "there is nothing more to tell"
        shared.step(1, place(9), reward=5.0, terminated=True)
        ((decision, outcome),) = segments(items)[1:]
        assert np.array_equal(decision.obs, shown[3])
        assert (outcome.reward, outcome.terminated) == (5.0, True)


@pytest.mark.parametrize(("algorithm", "pieces"), [("A2C", [6, 6]), ("RecurrentPPO", []), ("DQN", [])])
def test_who_shares_an_execution_is_learned_from_as_often_as_the_algorithm_learns(
    tmp_path: Path, algorithm: str, pieces: list[int]
) -> None:
    parameters = {} if algorithm == "DQN" else {"n_steps": 5}
    with station(tmp_path, algorithm=algorithm, parameters=parameters) as shared:
        items = watch(shared)
        for step in range(12):
            shared.step(1, place(step), reward=1.0)
        assert [len(it) for it in segments(items)] == pieces
