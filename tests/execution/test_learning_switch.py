"""Learning can be switched off and on at any step: what was learned stays as it is, and acts greedily."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from agents_app.algorithms.weights import flatten
from tests.execution.station import Station

ALGORITHMS = ["PPO", "DQN", "ARS", "RecurrentPPO"]


def weights(station: Station) -> np.ndarray:
    """What the learner has learned until now."""
    return flatten(station.algorithm.policy)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_switched_off_it_acts_greedily_with_what_it_learned(tmp_path: Path, algorithm: str) -> None:
    with Station(tmp_path, algorithm=algorithm, observations=5) as station:
        station.play(70)
        station.worker.set_learning(False)
        station.hold_learner()  # whatever it was doing is done
        before = weights(station)
        taken = [station.step(obs=3)["action"] for _ in range(10)]
        if algorithm != "RecurrentPPO":  # its memory may lead it elsewhere
            greedy, _ = station.algorithm.policy.predict(np.int64(3), deterministic=True)
            assert taken == [int(greedy)] * 10
        assert np.array_equal(weights(station), before)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_switched_on_again_in_the_middle_of_an_episode_it_learns(tmp_path: Path, algorithm: str) -> None:
    with Station(tmp_path, algorithm=algorithm, observations=5) as station:
        for learning in (False, True, False, True):
            station.worker.set_learning(learning)
            for _ in range(3):
                station.step(reward=1.0)
        assert station.step(reward=1.0, terminated=True)["episode"]["return"] == 12.0
        before = weights(station)
        station.play(80)
        station.wait_until(lambda: not np.array_equal(weights(station), before), "learning")


def test_an_execution_may_begin_switched_off(tmp_path: Path) -> None:
    with Station(tmp_path, learning=False) as station:
        station.play(60)
        assert station.learned_from == 0
        assert station.algorithm._n_updates == 0


def test_returns_say_whether_the_agent_was_learning(tmp_path: Path) -> None:
    with Station(tmp_path) as station:
        assert station.play(3, length=3)[-1]["episode"]["learning"] is True
        station.worker.set_learning(False)
        assert station.play(3, length=3)[-1]["episode"]["learning"] is False


def test_a_decision_of_learning_whose_outcome_comes_later_is_learned_from(tmp_path: Path) -> None:
    with Station(tmp_path) as station:
        for _ in range(4):
            station.step(reward=1.0)
        station.worker.set_learning(False)
        station.step(reward=1.0)
        station.step(reward=1.0, terminated=True)
        station.worker.set_learning(True)
        station.wait_until(lambda: station.learned_from >= 2)


def test_switched_off_amid_an_update_it_acts_with_what_that_update_brings(tmp_path: Path) -> None:
    slow = {"n_steps": 256, "batch_size": 8, "n_epochs": 30, "net_arch": "64,64", "learning_rate": 0.003}
    with Station(tmp_path, averaging=True, parameters=slow) as station:
        station.play(300)
        station.wait_until(lambda: station.worker.learner.updating, "an update")
        station.worker.set_learning(False)
        station.hold_learner()  # the update is over
        assert station.algorithm._n_updates == 30
        station.step()
        assert np.array_equal(flatten(station.worker.actor.policy), weights(station))


def test_what_was_learned_is_saved_as_learning_is_switched_off(tmp_path: Path) -> None:
    with Station(tmp_path) as station:
        station.play(70)
        station.worker.set_learning(False)
        station.hold_learner()
        chosen = station.worker.store.choose("latest")
        assert chosen is not None
        assert chosen.meta.steps == station.learned_from
