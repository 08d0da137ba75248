"""Advice between executions: from live peers at each step, their latest policies, evaluated here."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch as th
from gymnasium import spaces

from agents_app.algorithms.advice import neutral_advice, shaping_reward, without_advice
from agents_app.algorithms.replay import Outcome
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


@pytest.mark.parametrize("method", ["intersection", "union", "reuse", "geometric"])
@pytest.mark.parametrize("form", ["soft", "deterministic"])
def test_advice_of_forbidden_actions_alone_says_nothing(tmp_path: Path, method: str, form: str) -> None:
    with Station(tmp_path, advice_method=method, advice_form=form, action_masks=True) as station:
        mask, order = np.array([True, True, False]), np.array([0, 0, 1], np.float32)
        assert station.worker.see(station.somewhere(), order, mask)["advice"].tolist() == [1, 1, 1]


def test_of_equally_good_actions_an_order_names_none(tmp_path: Path) -> None:
    with advised(tmp_path, advice_form="deterministic") as station:
        for advice, order in (([1, 1, 1], [1, 1, 1]), ([0.4, 0.4, 0.2], [0.5, 0.5, 0]), ([0.2, 0.2, 0.6], [0, 0, 1])):
            seen = station.worker.see(station.somewhere(), np.array(advice, np.float32) / sum(advice))
            assert seen["advice"] == pytest.approx(order)


def test_what_does_not_fit_is_looked_at_once_and_asked_no_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with advised(tmp_path) as station:
        read: list[int] = []
        weights = station.peers.weights
        monkeypatch.setattr(station.peers, "weights", lambda number: read.append(number) or weights(number))
        station.peers.put(2, leaning(station, 1)[:-1])
        station.peers.put(3, leaning(station, 2))
        advice = [advice_of(station) for _ in range(50)]
        assert sorted(read) == [2, 3]
        assert sum(np.array_equal(it, np.ones(3)) for it in advice) <= 1
        assert station.worker.status()["advisors"] == [3]
        station.peers.put(2, leaning(station, 1))  # after a restart
        assert {int(advice_of(station).argmax()) for _ in range(50)} == {1, 2}


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


class TestWhoAdvises:
    def test_the_best_is_asked_alone(self, tmp_path: Path) -> None:
        with advised(tmp_path, advisors="best") as station:
            for action, mean_return in enumerate([3.0, 20.0, -5.0]):
                station.peers.put(2 + action, leaning(station, action), mean_return)
            assert {int(advice_of(station).argmax()) for _ in range(20)} == {1}
            assert station.worker.status()["advisors"] == [3]
            station.peers.put(4, leaning(station, 2), 21.0)
            assert advice_of(station).argmax() == 2
            del station.peers.published[4]
            assert advice_of(station).argmax() == 1

    def test_until_one_has_ended_an_episode_all_are_as_good(self, tmp_path: Path) -> None:
        with advised(tmp_path, advisors="best") as station:
            for action in range(2):
                station.peers.put(2 + action, leaning(station, action))
            assert {int(advice_of(station).argmax()) for _ in range(40)} == {0, 1}
            station.peers.returns[3] = -100.0
            assert {int(advice_of(station).argmax()) for _ in range(20)} == {1}

    @pytest.mark.parametrize("rho", [1.0, 0.7])
    def test_all_are_combined_by_equation_5_1(self, tmp_path: Path, rho: float) -> None:
        with advised(tmp_path, advisors="all", rho=rho) as station:
            strengths = [2.0, 1.0, 3.0]
            for action, strength in enumerate(strengths):
                station.peers.put(2 + action, leaning(station, action, strength))
            policies = [np.where(np.arange(3) == a, np.exp(s), 1) / (np.exp(s) + 2) for a, s in enumerate(strengths)]
            summed = sum(policy + 1 - rho for policy in policies) / 3
            assert advice_of(station) == pytest.approx(summed / summed.sum(), abs=1e-4)
            assert station.worker.status()["advisors"] == [2, 3, 4]

    @pytest.mark.parametrize("form", ["soft", "deterministic"])
    def test_or_by_the_geometric_mean_of_which_each_has_its_weight(self, tmp_path: Path, form: str) -> None:
        options: dict[str, Any] = {"advice_method": "geometric", "advisors": "all", "advice_form": form}
        with Station(tmp_path, advice_weight=0.5, **options) as station:
            strengths = [2.0, 1.0, 3.0]
            for action, strength in enumerate(strengths):
                station.peers.put(2 + action, leaning(station, action, strength))
            expected = np.exp(np.array(strengths) / 3)
            order = np.array([0, 0, expected.sum()])
            wanted = order if form == "deterministic" else expected
            assert advice_of(station) == pytest.approx(3 * wanted / wanted.sum(), abs=1e-4)

    def test_several_are_three_of_them_drawn_anew_at_each_step(self, tmp_path: Path) -> None:
        with advised(tmp_path, advisors="several") as station:
            for number, action in ((2, 0), (3, 0), (4, 1), (5, 1)):
                station.peers.put(number, leaning(station, action))
            heard = {tuple((3 * advice_of(station)).round().astype(int)) for _ in range(60)}
            assert heard == {(2, 1, 0), (1, 2, 0)}
            del station.peers.published[5], station.peers.published[4]
            assert advice_of(station)[0] > 0.99

    def test_of_continuous_actions_by_mean_it_is_the_mean_of_the_means(self, tmp_path: Path) -> None:
        with advised(tmp_path, advisors="all", actions=CONTINUOUS) as station:
            station.peers.put(2, leaning(station, 1, 8.0))
            station.peers.put(3, leaning(station, 0, 2.0))
            assert advice_of(station) == pytest.approx([1, 4, 1, 1], abs=1e-5)

    @pytest.mark.parametrize(
        "options",
        [
            {"continuous_advice": "sampling"},
            {"advice_method": "reuse"},
            {"advice_method": "shaping"},
            {"advisors": "several"},
        ],
        ids=str,
    )
    def test_elsewhere_one_is_drawn_at_each_step(self, tmp_path: Path, options: dict[str, Any]) -> None:
        given = {"advice_method": "intersection", "advisors": "all"} | options
        with Station(tmp_path, actions=CONTINUOUS, **given) as station:
            station.peers.put(2, leaning(station, 1, 8.0))
            station.peers.put(3, leaning(station, 0, 2.0))
            means = {tuple(advice_of(station)[:2].round(4)) for _ in range(40)}
            assert means == {(0.0, 8.0), (2.0, 0.0)}

    def test_one_that_has_just_gone_is_left_out(self, tmp_path: Path) -> None:
        with advised(tmp_path, advisors="all") as station:
            station.peers.put(2, leaning(station, 1))
            station.peers.put(3, leaning(station, 2))
            del station.peers.policies[3]
            assert advice_of(station).argmax() == 1
            assert advice_of(station)[1] > 0.99


class TestForm:
    def test_deterministic_advice_is_an_order(self, tmp_path: Path) -> None:
        with advised(tmp_path, advice_form="deterministic") as station:
            station.peers.put(2, leaning(station, 1, 0.5))
            assert np.array_equal(advice_of(station), [0, 1, 0])
            assert {station.step()["action"] for _ in range(30)} == {1}

    def test_or_the_mean(self, tmp_path: Path) -> None:
        facts: dict[str, Any] = {"continuous_advice": "sampling", "last_word": "advisor"}
        with advised(tmp_path, advice_form="deterministic", actions=CONTINUOUS, **facts) as station:
            station.peers.put(2, leaning(station, 1, 1.5))
            assert advice_of(station) == pytest.approx([0, 1.5, 0.004, 0.004], abs=1e-5)
            actions = [station.step()["action"] for _ in range(30)]
            assert np.abs(np.array(actions) - [0, 1.5]).max() < 0.03

    def test_alone_there_is_no_order(self, tmp_path: Path) -> None:
        with advised(tmp_path, advice_form="deterministic") as station:
            assert np.array_equal(advice_of(station), np.ones(3))

    def test_what_the_client_says_is_an_order_then(self, tmp_path: Path) -> None:
        for form, floor in (("soft", 1e-7), ("deterministic", 0.0)):
            with advised(tmp_path / form, advice_form=form) as station:
                said = station.worker.see(station.somewhere(), np.array([0, 0, 1], np.float32))["advice"]
                assert said[2] == pytest.approx(1.0, abs=1e-5)
                assert (said[:2] >= floor).all() and (said[:2].max() == 0) == (floor == 0)


METHODS: list[dict[str, Any]] = [
    {"advice_method": "intersection", "continuous_advice": "sampling"},
    {"advice_method": "geometric", "advice_weight": 2.0},
    {"advice_method": "union"},
    {"advice_method": "reuse"},
    {"advice_method": "shaping"},
    {"advice_method": "reuse", "advisors": "all", "advice_form": "deterministic"},
    {"advice_method": "intersection", "advisors": "best", "last_word": "advisor"},
]


FITTING = [(facts, actions) for facts in METHODS for actions in (DISCRETE, CONTINUOUS)]
FITTING.remove(({"advice_method": "union"}, CONTINUOUS))


@pytest.mark.parametrize("kind", ["vector", "image"])
@pytest.mark.parametrize(("facts", "actions"), FITTING, ids=str)
@pytest.mark.parametrize("algorithm", ["PPO", "TRPO"])
def test_every_method_acts_and_learns(
    tmp_path: Path, algorithm: str, facts: dict[str, Any], kind: str, actions: Any
) -> None:
    with Station(tmp_path, algorithm=algorithm, observations=OBSERVATIONS[kind], actions=actions, **facts) as station:
        station.peers.put(2, leaning(station, 1, 3.0), 1.0)
        station.peers.put(3, leaning(station, 0, 1.0), 2.0)
        assert {answer["k"] for answer in station.play(70)} == {"answer"}
        station.wait_until(lambda: station.algorithm._n_updates > 0)
        assert station.told("error") == []


class TestShaping:
    @BOTH
    def test_the_learner_is_rewarded_for_what_the_advisor_would_do(self, tmp_path: Path, actions: Any) -> None:
        facts: dict[str, Any] = {"advice_method": "shaping", "shaping_scale": 2.0, "actions": actions}
        with Station(tmp_path, **facts) as station:
            let_go = station.hold_learner()
            station.peers.put(2, leaning(station, 1, 1.0))
            asked = advice_of(station)
            answers = [station.step(reward=5.0) for _ in range(4)]
            end = station.step(reward=5.0, terminated=True)
            assert end["episode"]["return"] == 20.0, "the curve is the client's own"
            rewards = [item.reward for item in station.worker.feed._items if isinstance(item, Outcome)]
            expected = [5.0 + 2.0 * shaping_reward(asked, np.array(answer["action"])) for answer in answers]
            assert rewards == pytest.approx(expected, rel=1e-4)
            assert min(rewards) > 5.0
            let_go()

    def test_it_changes_no_action(self, tmp_path: Path) -> None:
        taken = []
        for method in ("none", "shaping"):
            with Station(tmp_path / method, advice_method=method, observations=5, seed=4) as station:
                station.peers.put(2, leaning(station, 0, 50.0))
                taken.append([station.step(obs=2)["action"] for _ in range(30)])
        assert taken[0] == taken[1]
        assert set(taken[0]) == {0, 1, 2}

    def test_alone_there_is_no_reward_for_anything(self, tmp_path: Path) -> None:
        with Station(tmp_path, advice_method="shaping") as station:
            let_go = station.hold_learner()
            station.play(5, length=5)
            rewards = [item.reward for item in station.worker.feed._items if isinstance(item, Outcome)]
            assert rewards == [1.0] * 5
            let_go()


@BOTH
@EVERY
def test_a_frozen_policy_advises_exactly_as_it_acted(tmp_path: Path, kind: str, actions: Any) -> None:
    """What is loaded from a save advises with the probabilities from which the saved one drew its actions."""
    facts: dict[str, Any] = {"observations": OBSERVATIONS[kind], "actions": actions}
    with advised(tmp_path, **facts) as station:
        station.play(70)
        station.wait_until(lambda: station.algorithm._n_updates > 0)
    acted = station.algorithm.policy
    with advised(tmp_path, uid="second", number=2, **facts) as frozen:
        assert frozen.algorithm.num_timesteps > 0, "it was loaded"
        loaded = flatten(frozen.algorithm.policy)
    assert np.array_equal(loaded, flatten(acted))
    with advised(tmp_path / "other", seed=9, **facts) as learner:
        learner.peers.put(2, loaded)
        for _ in range(5):
            obs = learner.worker.see(learner.somewhere())
            with th.no_grad():
                policy = acted.get_distribution(acted.obs_to_tensor(without_advice(obs))[0]).distribution
            own = policy.probs if actions == DISCRETE else th.cat([policy.mean, policy.stddev], -1)
            assert obs["advice"] == pytest.approx(own[0].numpy(), abs=1e-5)
