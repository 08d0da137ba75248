"""Advice between executions of DQN, QR-DQN, SAC, TQC, TD3 and DDPG: given, acted on, learned from, replayed as it was."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch as th

from agents_app.algorithms.actor import advice_weights
from agents_app.algorithms.advice import neutral_advice
from tests.algorithms.specs import CONTINUOUS, DISCRETE, OBSERVATIONS
from tests.execution.station import Station

VALUES, ACTORS = ["DQN", "QR-DQN"], ["SAC", "TQC", "TD3", "DDPG"]
EVERY = pytest.mark.parametrize("algorithm", [*VALUES, *ACTORS])


def advised(folder: Path, algorithm: str, **options: Any) -> Station:
    """An execution that takes advice; its noise is small, if it has any."""
    actions = DISCRETE if algorithm in VALUES else CONTINUOUS
    noise = {"action_noise": "normal 0.05"} if algorithm in ("TD3", "DDPG") else {}
    parameters = noise | options.pop("parameters", {})
    facts: dict[str, Any] = {"advice_method": "intersection", "actions": actions, "parameters": parameters}
    return Station(folder, algorithm=algorithm, **facts | options)


def leaning(station: Station, exploration: float = 0.03) -> np.ndarray:
    """What a peer publishes that prefers action 1 everywhere, or the largest numbers; this execution's own is overwritten."""
    model = station.algorithm
    with th.no_grad():
        if hasattr(model, "exploration_rate"):
            model.exploration_rate = exploration
            last = (model.q_net.q_net if hasattr(model, "q_net") else model.quantile_net.quantile_net)[-1]
            last.bias.view(-1, 3)[:] = th.tensor([0.0, 1.0, 0.0])
        else:
            last = model.actor.mu if isinstance(model.actor.mu, th.nn.Linear) else model.actor.mu[-2]
            last.bias[:] = 4.0
        last.weight.zero_()
    return advice_weights(model.policy)


def advice_of(station: Station) -> np.ndarray:
    """The advice of this moment."""
    return station.worker.see(station.somewhere())["advice"]


@EVERY
@pytest.mark.parametrize("kind", OBSERVATIONS)
def test_the_advice_is_what_the_peer_would_do(tmp_path: Path, algorithm: str, kind: str) -> None:
    with advised(tmp_path, algorithm, observations=OBSERVATIONS[kind]) as station:
        station.hold_learner()
        assert np.array_equal(advice_of(station), neutral_advice(station.worker.action_space))
        station.peers.put(2, leaning(station))
        advice = advice_of(station)
        if algorithm in VALUES:
            assert advice == pytest.approx([0.01, 0.98, 0.01], abs=1e-4)
        else:
            assert advice[:2] == pytest.approx([2.0, 2.0], abs=0.01)
            assert (advice[2:] > 0).all()


@EVERY
def test_it_is_acted_on_and_learned_from(tmp_path: Path, algorithm: str) -> None:
    with advised(tmp_path, algorithm, continuous_advice="sampling") as station:
        let_go = station.hold_learner()
        station.peers.put(2, leaning(station, exploration=0.0))
        let_go()
        taken = [answer["action"] for answer in station.play(60) if not answer["ended"]]
        station.wait_until(lambda: station.algorithm._n_updates > 2)
        buffer = station.algorithm.replay_buffer
        stored = buffer.actions[: buffer.pos, 0]
    if algorithm in VALUES:
        assert taken == [1] * len(taken)
        assert (stored == 1).all()
    else:
        assert np.mean(taken) > 1.9
        assert stored.mean() > 0.9


@EVERY
def test_it_publishes_what_peers_need_and_no_more(tmp_path: Path, algorithm: str) -> None:
    with advised(tmp_path, algorithm) as station:
        station.play(40)
        station.wait_until(lambda: len(station.published) > 2)
        station.hold_learner()
        model, last = station.algorithm, station.published[-1]
        net = model.policy.q_net if algorithm == "DQN" else getattr(model, "quantile_net", None) or model.actor
        size = sum(parameter.numel() for parameter in net.parameters()) + (algorithm in VALUES)
        assert {len(weights) for weights in station.published} == {size}
        assert not np.array_equal(station.published[0], last)
        station.peers.put(2, last)
        obs = station.somewhere()
        with th.no_grad():
            own = model.policy.get_distribution(th.as_tensor(obs)[None]).distribution
        expected = own.probs[0] if algorithm in VALUES else th.cat([own.mean[0], own.stddev[0]])
        slack = 0.02 if algorithm in VALUES else 1e-4  # the rate of exploration goes on with the steps
        assert station.worker.see(obs)["advice"] == pytest.approx(expected.numpy(), abs=slack)


@pytest.mark.parametrize("algorithm", VALUES)
def test_a_peer_that_explores_still_hardly_advises(tmp_path: Path, algorithm: str) -> None:
    with advised(tmp_path, algorithm) as station:
        station.hold_learner()
        station.peers.put(2, leaning(station, exploration=1.0))
        assert advice_of(station) == pytest.approx([1 / 3] * 3, abs=1e-4)


@EVERY
def test_a_save_restores_what_is_advised(tmp_path: Path, algorithm: str) -> None:
    parameters = {"total_timesteps": 100} if algorithm in VALUES else {}
    with advised(tmp_path, algorithm, parameters=parameters) as station:
        station.play(60)
        station.wait_until(lambda: station.algorithm._n_updates > 2)
    before = advice_weights(station.algorithm.policy)
    with advised(tmp_path, algorithm, uid="second", parameters=parameters) as station:
        assert np.array_equal(advice_weights(station.algorithm.policy), before)


SETTINGS: dict[str, dict[str, Any]] = {
    "reward": {"advice_method": "shaping"},
    "geometric": {"advice_method": "geometric", "advice_weight": 2.0},
    "union": {"advice_method": "union"},
    "reuse": {"advice_method": "reuse", "advisors": "best"},
    "order": {"continuous_advice": "sampling", "advice_form": "deterministic", "last_word": "advisor"},
    "all": {"advisors": "all"},
}


@EVERY
@pytest.mark.parametrize("setting", SETTINGS)
def test_it_learns_under_every_setting(tmp_path: Path, algorithm: str, setting: str) -> None:
    facts = SETTINGS["reuse" if setting == "union" and algorithm in ACTORS else setting]
    with advised(tmp_path, algorithm, **facts) as station:
        let_go = station.hold_learner()
        for number in (2, 3):
            station.peers.put(number, leaning(station))
        let_go()
        station.play(30)
        station.wait_until(lambda: station.algorithm._n_updates > 0)
        assert station.told("error") == []
