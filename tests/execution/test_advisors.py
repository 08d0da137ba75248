"""Advice between executions: from a random live peer at each step, its latest policy, evaluated here."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch as th
from gymnasium import spaces

from agents_app.algorithms.advice import neutral_advice
from agents_app.algorithms.weights import assign, flatten
from tests.algorithms.specs import CONTINUOUS, DISCRETE, OBSERVATIONS
from tests.execution.station import Station

BOTH = pytest.mark.parametrize("actions", [DISCRETE, CONTINUOUS], ids=["discrete", "continuous"])
EVERY = pytest.mark.parametrize("kind", OBSERVATIONS)


def advised(folder: Path, **options: Any) -> Station:
    """An execution that takes advice."""
    return Station(folder, advice_method="intersection", **options)


def leaning(station: Station, action: int, strength: float = 8.0) -> np.ndarray:
    """Weights of a peer that nearly always chooses `action`, or means of 1.5 in that dimension."""
    before = flatten(station.algorithm.policy)
    with th.no_grad():
        station.algorithm.policy.action_net.weight.zero_()
        station.algorithm.policy.action_net.bias.zero_()
        station.algorithm.policy.action_net.bias[action] = strength
    leaning = flatten(station.algorithm.policy)
    assign(station.algorithm.policy, before)
    return leaning


def advice_of(station: Station) -> np.ndarray:
    """The advice of this moment."""
    assert station.worker.advisors is not None
    return station.worker.see(station.somewhere())["advice"]


@EVERY
@BOTH
def test_alone_the_advice_is_neutral(tmp_path: Path, kind: str, actions: Any) -> None:
    with advised(tmp_path, observations=OBSERVATIONS[kind], actions=actions) as station:
        assert np.array_equal(advice_of(station), neutral_advice(station.worker.action_space))
        assert station.worker.status()["advisors"] == []


@EVERY
@BOTH
def test_the_advice_is_what_the_peer_would_do(tmp_path: Path, kind: str, actions: Any) -> None:
    with advised(tmp_path, observations=OBSERVATIONS[kind], actions=actions) as station:
        station.peers.put(2, leaning(station, 1))
        advice = advice_of(station)
        if isinstance(station.worker.action_space, spaces.Discrete):
            odds = np.exp([0, 8, 0])
            assert advice == pytest.approx(odds / odds.sum(), abs=1e-4)
        else:
            assert advice == pytest.approx([0, 8, 1, 1], abs=1e-5)  # means, then deviations
        assert station.worker.status()["advisors"] == [2]


@EVERY
@BOTH
@pytest.mark.parametrize("correction", [True, False], ids=["correction", "no correction"])
@pytest.mark.parametrize("algorithm", ["PPO", "A2C"])
def test_advice_is_acted_on_and_learned_from(
    tmp_path: Path, algorithm: str, kind: str, actions: Any, correction: bool
) -> None:
    facts: dict[str, Any] = {"algorithm": algorithm, "learning_correction": correction}
    with advised(tmp_path, observations=OBSERVATIONS[kind], actions=actions, **facts) as station:
        station.peers.put(2, leaning(station, 1, 50.0))
        taken = [answer["action"] for answer in station.play(70) if not answer["ended"]]
        station.wait_until(lambda: station.algorithm._n_updates > 0)
    if actions == DISCRETE:
        assert taken == [1] * len(taken), "the peer is sure"
    else:
        assert np.mean([action[1] for action in taken]) == pytest.approx(2.0), "clipped, as half of 50 is"


def test_the_latest_policy_of_a_peer_is_taken(tmp_path: Path) -> None:
    with advised(tmp_path) as station:
        for action in (1, 2, 0):
            station.peers.put(2, leaning(station, action))
            assert advice_of(station).argmax() == action


def test_each_live_peer_advises_in_its_turn(tmp_path: Path) -> None:
    with advised(tmp_path) as station:
        for action in range(3):
            station.peers.put(2 + action, leaning(station, action))
        chosen = [int(advice_of(station).argmax()) for _ in range(300)]
        assert np.bincount(chosen, minlength=3).min() > 60
        assert station.worker.status()["advisors"] == [2, 3, 4]


def test_a_peer_that_has_gone_advises_no_more(tmp_path: Path) -> None:
    with advised(tmp_path) as station:
        station.peers.put(2, leaning(station, 1))
        advice_of(station)
        del station.peers.published[2]
        assert np.array_equal(advice_of(station), np.ones(3))
        station.peers.put(3, leaning(station, 2))
        assert advice_of(station).argmax() == 2


def test_a_peer_whose_weights_have_just_gone_is_passed_over(tmp_path: Path) -> None:
    with advised(tmp_path) as station:
        station.peers.put(2, leaning(station, 1))
        del station.peers.policies[2]
        assert np.array_equal(advice_of(station), np.ones(3))


def test_a_network_of_another_shape_is_passed_over(tmp_path: Path) -> None:
    with advised(tmp_path) as station:
        station.peers.put(2, np.zeros(17, np.float32))
        assert np.array_equal(advice_of(station), np.ones(3))
        station.peers.put(2, leaning(station, 1))
        assert advice_of(station).argmax() == 1
        station.peers.put(2, np.zeros(17, np.float32))
        assert np.array_equal(advice_of(station), np.ones(3))


def test_less_influence_is_softer(tmp_path: Path) -> None:
    certainty = []
    for rho in (1.0, 0.7, 0.0):
        with advised(tmp_path, rho=rho) as station:
            station.peers.put(2, leaning(station, 1))
            certainty.append(float(advice_of(station).max()))
    assert certainty[0] > 0.99
    assert certainty[1] == pytest.approx(1.3 / 1.9, abs=0.01)
    assert certainty[2] == pytest.approx(2 / 4, abs=0.01)


def test_an_execution_publishes_what_it_begins_with_and_what_it_learns(tmp_path: Path) -> None:
    with advised(tmp_path) as station:
        first = flatten(station.algorithm.policy)
        station.play(40)
        station.wait_until(lambda: len(station.published) == 2)
        assert np.array_equal(station.published[0], first)
        assert np.array_equal(station.published[1], flatten(station.algorithm.policy))


def test_asking_for_advice_changes_nothing_in_what_is_drawn(tmp_path: Path) -> None:
    """A neutral peer: the same actions as without one, since advisors draw from a generator of their own."""
    taken = []
    for peers in (0, 3):
        with advised(tmp_path / str(peers), observations=5, seed=4) as station:
            for number in range(peers):
                station.peers.put(2 + number, leaning(station, 0, 0.0))
            taken.append([station.step(obs=2)["action"] for _ in range(30)])
    assert taken[0] == taken[1]


def test_agents_that_take_no_advice_publish_nothing(tmp_path: Path) -> None:
    with Station(tmp_path) as station:
        station.play(70)
        assert station.worker.advisors is None
        assert station.published == []
