"""ARS plays ShepherdEnv itself: its own action goes to the client, and it waits for what comes of it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.execution.station import Station


@pytest.fixture
def station(tmp_path: Path) -> Iterator[Station]:
    """ARS with one direction: two candidates, an episode each, make an update."""
    with Station(tmp_path, algorithm="ARS") as one:
        yield one


def test_two_episodes_make_an_update(station: Station) -> None:
    for reward in (1.0, 2.0):
        station.play(5, length=5, reward=reward)
    station.step()
    station.wait_until(lambda: station.algorithm._n_updates == 1)
    assert station.learned_from == 10


def test_every_transition_is_seen_once(station: Station) -> None:
    station.play(40)
    station.step()  # the last end is seen when the next episode begins
    station.wait_until(lambda: station.learned_from == 40)


def test_an_episode_that_breaks_off_ends_and_the_next_begins(station: Station) -> None:
    for _ in range(4):
        station.step(session=1)
    station.desk.release(1)
    assert station.step(session=2)["k"] == "answer"
    assert station.step(session=2, terminated=True)["episode"]["length"] == 1
    station.step(session=2)
    station.wait_until(lambda: station.learned_from == 5)  # 3 outcomes, the broken end, and one of session 2


def test_an_episode_may_end_with_its_first_message(station: Station) -> None:
    assert station.step(terminated=True)["ended"]
    station.play(20)


def test_a_retry_while_the_algorithm_thinks_gets_the_one_answer(station: Station) -> None:
    station.step(seq=1)
    answer = station.step(seq=2)
    assert station.step(seq=2) == answer
    station.step(seq=3, terminated=True)
    station.step(seq=4)
    station.wait_until(lambda: station.learned_from == 2)


def test_evaluation_teaches_it_nothing(station: Station) -> None:
    station.play(20)
    station.worker.set_learning(False)
    before = station.learned_from
    station.play(20)
    assert station.learned_from <= before + 1
    station.worker.set_learning(True)
    station.play(20)
    station.wait_until(lambda: station.learned_from >= before + 19)


def test_a_save_is_made_while_it_waits(station: Station) -> None:
    station.play(20)
    station.worker.save_now()
    station.wait_until(lambda: station.told("saved"))
    assert station.play(10)[-1]["ended"]


def test_continuous_actions_stay_within_their_bounds(tmp_path: Path) -> None:
    facts = {"algorithm": "ARS", "actions": [[2], -0.5, 0.5], "parameters": {"delta_std": 50.0}}
    with Station(tmp_path, **facts) as station:
        actions = [answer["action"] for answer in station.play(30) if not answer["ended"]]
    assert all(-0.5 <= number <= 0.5 for action in actions for number in action)
    assert any(number != 0 for action in actions for number in action)
