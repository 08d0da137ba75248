"""Advice between executions that share weights with their learner: what a peer publishes is what it acts with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch as th

from agents_app.algorithms.actor import advice_weights
from tests.algorithms.specs import OBSERVATIONS
from tests.execution.station import Station

KINDS = pytest.mark.parametrize("kind", ["discrete", "vector", "dict"])


def advised(folder: Path, **options: Any) -> Station:
    """A BDPI that takes advice."""
    return Station(folder, **{"algorithm": "BDPI", "advice_method": "intersection"} | options)


def leaning(station: Station, action: int, strength: float) -> np.ndarray:
    """What a peer publishes that prefers `action` everywhere; this execution's own actor is overwritten."""
    last = station.algorithm.policy.actor.layers[-1]
    with th.no_grad():
        last.zero_()
        last[:, -1, action] = strength  # of the bias
    return advice_weights(station.algorithm.policy)


@KINDS
def test_the_advice_is_what_the_peer_would_do(tmp_path: Path, kind: str) -> None:
    with advised(tmp_path, observations=OBSERVATIONS[kind]) as station:
        station.peers.put(2, leaning(station, 1, 4.0))
        odds = np.exp([0.0, 4.0, 0.0])
        advice = station.worker.see(station.somewhere())["advice"]
        assert advice == pytest.approx(odds / odds.sum(), abs=1e-4)
        assert station.worker.status()["advisors"] == [2]


@pytest.mark.parametrize("correction", [True, False], ids=["correction", "no correction"])
@pytest.mark.parametrize("method", ["intersection", "reuse"])
def test_it_is_acted_on_and_learned_from(tmp_path: Path, method: str, correction: bool) -> None:
    facts: dict[str, Any] = {"advice_method": method, "psi": 1.0, "learning_correction": correction}
    with advised(tmp_path, **facts) as station:
        station.peers.put(2, leaning(station, 1, 50.0))
        taken = [answer["action"] for answer in station.play(40) if not answer["ended"]]
        station.wait_until(lambda: station.algorithm._n_updates > 0)
    assert taken == [1] * len(taken), "the peer is sure"


def test_it_publishes_its_actor_and_no_critics(tmp_path: Path) -> None:
    with advised(tmp_path) as station:
        actor = station.algorithm.actor
        station.play(40)
        station.wait_until(lambda: len(station.published) > 2)
        station.hold_learner()
        assert {len(weights) for weights in station.published} == {sum(p.numel() for p in actor.parameters())}
        assert not np.array_equal(station.published[0], station.published[-1])
        station.peers.put(2, station.published[-1])
        obs = station.somewhere()
        with th.no_grad():
            expected = station.algorithm.policy.get_distribution(th.as_tensor(obs)[None]).distribution.probs[0]
        assert station.worker.see(obs)["advice"] == pytest.approx(expected.numpy(), abs=1e-5)


def test_alone_it_publishes_nothing(tmp_path: Path) -> None:
    with Station(tmp_path, algorithm="BDPI") as station:
        station.play(40)
        station.wait_until(lambda: station.algorithm._n_updates > 0)
        assert station.published == []
