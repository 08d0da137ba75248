"""Executions that learn together: each takes over what the updates of the others have changed."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from torch import nn

from agents_app.algorithms.registry import ROWS
from agents_app.algorithms.weights import assign, flatten, parameters_of
from envs_app.execution.averaging import FULL_VOICE, Averaging, News, merge
from envs_app.execution.desk import CATCH_UP_SECONDS
from tests.algorithms.specs import CONTINUOUS, DISCRETE
from tests.execution.station import FixedPeers, Station

ROUNDS = 30
NUMBERS = st.lists(st.floats(-10, 10, width=32), min_size=3, max_size=3).map(lambda it: np.array(it, np.float32))


def learning(folder: Path, **options: Any) -> Station:
    """An execution that averages."""
    return Station(folder, averaging=True, **options)


@pytest.fixture
def station(tmp_path: Path) -> Any:
    """One that normalises observations too, and has learned nothing yet."""
    with learning(tmp_path, parameters={"n_steps": 32, "normalize_observations": True}) as station:
        yield station


def publish(
    peers: FixedPeers, number: int, weights: np.ndarray, total: np.ndarray, times: int = 1, before: int = 0
) -> None:
    """Execution `number` says so many times what it knows, and by how much its own updates have changed that.

    `before`: updates of others that it has taken over.
    """
    for _ in range(times):
        updates = peers.published.get(number, 0)
        tail = [min(updates, FULL_VOICE), before + updates]
        peers.put(number, np.concatenate([weights, total, tail], dtype=np.float32))


@given(NUMBERS, st.lists(NUMBERS, min_size=2, max_size=5))
def test_who_began_together_goes_on_from_the_mean(start: np.ndarray, changes: list[np.ndarray]) -> None:
    own, *others = (News(FULL_VOICE, start + change, change) for change in changes)
    assert merge(start, own, others) == pytest.approx(start + np.mean(changes, axis=0), abs=1e-4)


@given(NUMBERS, NUMBERS, st.integers(1, FULL_VOICE))
def test_a_newcomer_takes_over_what_is_known(start: np.ndarray, known: np.ndarray, voice: int) -> None:
    merged = merge(start, News(0, start, np.zeros_like(start)), [News(voice, known, np.zeros_like(start))])
    assert merged == pytest.approx(known, abs=1e-4)


@given(NUMBERS, NUMBERS, NUMBERS)
def test_what_a_peer_began_with_long_ago_holds_nobody_back(
    start: np.ndarray, old: np.ndarray, change: np.ndarray
) -> None:
    peer = News(FULL_VOICE, old, change)
    merged = merge(start, News(FULL_VOICE, start + change, change), [peer])
    assert merged == pytest.approx(0.9 * (start + change) + 0.1 * (start + change + old) / 2, abs=1e-4)


@given(NUMBERS, NUMBERS, NUMBERS)
def test_whoever_is_heard_for_the_first_time_does_not_halve_what_one_has_learned(
    start: np.ndarray, change: np.ndarray, known: np.ndarray
) -> None:
    merged = merge(start, News(FULL_VOICE, start + change, change), [News(FULL_VOICE, known, None)])
    assert merged == pytest.approx(0.9 * (start + change) + 0.1 * (start + change + known) / 2, abs=1e-4)


def test_voices_grow_with_what_was_learned(station: Station) -> None:
    averaging = Averaging(station.algorithm.policy, station.peers)
    voices, known = zip(
        *(averaging.publication(flatten(station.algorithm.policy))[-2:] for _ in range(13)), strict=True
    )
    assert voices == (*range(10), FULL_VOICE, FULL_VOICE, FULL_VOICE)
    assert known == tuple(range(13))


def begins_with(station: Station, knows: int) -> tuple[Averaging, np.ndarray, int]:
    """One that goes on from a save in which are so many updates; its weights, and how many of them are parameters."""
    begun, averaging = flatten(station.algorithm.policy), Averaging(station.algorithm.policy, station.peers, knows)
    averaging.publication(begun)
    return averaging, begun, averaging.parameters


def test_what_was_restored_is_not_lost_to_a_peer_that_stopped_learning_long_ago(station: Station) -> None:
    averaging, begun, size = begins_with(station, knows=500)
    publish(station.peers, 2, begun + 5, np.ones(size), times=20)
    assert not averaging.go_on()
    assert np.array_equal(flatten(station.algorithm.policy), begun)
    said = averaging.publication(begun)
    assert list(said[-2:]) == [FULL_VOICE, 501]
    publish(station.peers, 2, begun + 5, np.ones(size))  # says the same again
    assert not averaging.go_on()


def test_whoever_goes_on_from_a_save_follows_those_who_learned_on_meanwhile(station: Station) -> None:
    averaging, begun, size = begins_with(station, knows=500)
    publish(station.peers, 2, begun + 5, np.ones(size), times=20, before=480)
    publish(station.peers, 3, begun + 9, np.ones(size), times=20)  # long ago
    assert not averaging.go_on(), "499 are less than 500"
    averaging, begun, size = begins_with(station, knows=499)
    assert averaging.go_on()
    assert flatten(station.algorithm.policy)[:size] == pytest.approx(begun[:size] + 5, abs=1e-4)
    assert list(averaging.publication(flatten(station.algorithm.policy))[-2:]) == [1, 500]


def test_a_newcomer_does_not_go_by_what_was_known_long_ago(station: Station) -> None:
    averaging, begun, size = begins_with(station, knows=0)
    publish(station.peers, 2, begun + 5, np.ones(size), times=12)
    publish(station.peers, 3, begun + 1, np.ones(size), times=24)
    publish(station.peers, 4, begun + 3, np.ones(size), times=15, before=20)
    assert averaging.go_on()
    assert flatten(station.algorithm.policy)[:size] == pytest.approx(begun[:size] + 3, abs=1e-4)
    assert averaging.knows == 34


def test_one_that_nobody_uses_keeps_up_with_the_others(tmp_path: Path) -> None:
    with learning(tmp_path, parameters={"n_steps": 16}) as station:
        station.play(40)
        station.wait_until(lambda: station.algorithm._n_updates >= 4, "two updates")
        station.hold_learner()()
        before, size = flatten(station.algorithm.policy), parameters_of(station.algorithm.policy)
        publish(station.peers, 2, before + 5, np.ones(size), times=10)
        station.desk.catch_up()
        station.hold_learner()()
        assert np.array_equal(flatten(station.algorithm.policy), before), "it is in use"
        station.desk.used_at = station.desk.caught_up_at = time.monotonic() - CATCH_UP_SECONDS
        station.desk.catch_up()
        station.hold_learner()()
        assert np.array_equal(flatten(station.algorithm.policy), before), "it is hardly behind"
        publish(station.peers, 2, before + 5, np.ones(size), times=30)
        publish(station.peers, 3, before + 9, np.ones(size), times=15)
        station.desk.caught_up_at -= CATCH_UP_SECONDS
        station.desk.catch_up()
        station.hold_learner()()
        assert flatten(station.algorithm.policy)[:size] == pytest.approx(before[:size] + 5, abs=1e-3)
        station.worker.refresh()
        assert flatten(station.worker.actor.policy)[:size] == pytest.approx(before[:size] + 5, abs=1e-3)
        assert station.worker.averaging.knows == 39
        station.worker.set_learning(False)
        publish(station.peers, 2, before + 7, np.ones(size), times=30)
        station.desk.caught_up_at -= CATCH_UP_SECONDS
        station.desk.catch_up()
        station.hold_learner()()
        assert flatten(station.algorithm.policy)[:size] == pytest.approx(before[:size] + 5, abs=1e-3), (
            "it learns nothing now"
        )


@given(st.integers(1, 12), st.integers(2, 6))
def test_they_go_as_fast_as_one_however_seldom_they_may_publish(updates: int, executions: int) -> None:
    said = [FixedPeers() for _ in range(executions)]
    policies = [nn.Linear(1, 1) for _ in range(executions)]
    for policy in policies:
        assign(policy, np.zeros(2, np.float32))
    everybody = [Averaging(policy, it) for policy, it in zip(policies, said, strict=True)]

    def speak(number: int, publication: np.ndarray) -> None:
        for it in said[:number] + said[number + 1 :]:
            it.put(number, publication)

    for number, averaging in enumerate(everybody):
        speak(number, averaging.publication(flatten(policies[number])))
    for _ in range(ROUNDS):
        for number, averaging in enumerate(everybody):
            for _ in range(updates):  # only the last one is published
                assign(policies[number], flatten(policies[number]) + np.float32(1.0))
                publication = averaging.publication(flatten(policies[number]))
            speak(number, publication)
            averaging.go_on()
    assert flatten(policies[0]) / (ROUNDS * updates) == pytest.approx(1.0, abs=0.1)
    assert [averaging.knows >= ROUNDS * updates for averaging in everybody] == [True] * executions


def test_what_two_learn_reaches_both(station: Station) -> None:
    policy, size = station.algorithm.policy, parameters_of(station.algorithm.policy)
    station.algorithm.normaliser.observe(np.random.default_rng(1).normal(5.0, 2.0, (100, 3)))
    begun, averaging = flatten(policy), Averaging(policy, station.peers)
    averaging.publication(begun)
    assert not averaging.go_on()
    publish(station.peers, 2, begun, np.zeros(size), times=FULL_VOICE + 1)
    for _ in range(FULL_VOICE):
        averaging.publication(flatten(policy))
        averaging.go_on()
    learned, theirs = begun.copy(), np.zeros(size, np.float32)
    learned[:size] += 2
    theirs += 4
    assign(policy, learned)
    said = averaging.publication(flatten(policy))
    assert said[: begun.size] == pytest.approx(learned)
    assert said[begun.size : -2] == pytest.approx(np.full(size, 2), abs=1e-5)
    publish(station.peers, 2, np.concatenate([begun[:size] + theirs, begun[size:] + 9]), theirs)
    assert averaging.go_on()
    after = flatten(policy)
    assert after[:size] == pytest.approx(begun[:size] + 3, abs=1e-5)
    assert np.array_equal(after[size:], begun[size:])  # its own normalisation
    assert not averaging.go_on()  # nobody is heard twice
    assert averaging.publication(flatten(policy))[begun.size : -2] == pytest.approx(np.full(size, 2), abs=1e-5)


def test_nobody_is_heard_before_it_has_learned(station: Station) -> None:
    begun, size = flatten(station.algorithm.policy), parameters_of(station.algorithm.policy)
    averaging = Averaging(station.algorithm.policy, station.peers)
    publish(station.peers, 2, begun + 1, np.ones(size))
    averaging.publication(begun)
    assert not averaging.go_on()
    publish(station.peers, 2, begun + 1, np.ones(size))
    assert averaging.go_on()
    assert flatten(station.algorithm.policy)[:size] == pytest.approx(begun[:size] + 1, abs=1e-5)


def test_what_two_learn_at_first_reaches_both_once(station: Station) -> None:
    policy, size = station.algorithm.policy, parameters_of(station.algorithm.policy)
    begun, averaging = flatten(policy), Averaging(policy, station.peers)
    averaging.publication(begun)
    learned = np.concatenate([begun[:size] + 2, begun[size:]])
    assign(policy, learned)
    averaging.publication(learned)
    publish(station.peers, 2, begun, np.zeros(size))
    publish(station.peers, 2, np.concatenate([begun[:size] + 4, begun[size:]]), np.full(size, 4.0))
    assert averaging.go_on()
    assert flatten(policy)[:size] == pytest.approx(begun[:size] + 3, abs=1e-5)
    publish(station.peers, 2, begun, np.full(size, 4.0))  # announced once more
    assert not averaging.go_on()


def test_whoever_goes_on_from_a_save_sees_with_its_own_statistics(station: Station) -> None:
    policy, size = station.algorithm.policy, parameters_of(station.algorithm.policy)
    station.algorithm.normaliser.observe(np.random.default_rng(1).normal(5.0, 2.0, (100, 3)))
    begun, averaging = flatten(policy), Averaging(policy, station.peers)
    averaging.publication(begun)
    publish(station.peers, 2, begun + 3, np.ones(size), times=2)
    assert averaging.go_on()
    assert flatten(policy)[:size] == pytest.approx(begun[:size] + 3, abs=1e-4)
    assert np.array_equal(flatten(policy)[size:], begun[size:])


@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid value")
def test_a_peer_that_diverges_takes_nobody_along(station: Station) -> None:
    begun, size = flatten(station.algorithm.policy), parameters_of(station.algorithm.policy)
    averaging = Averaging(station.algorithm.policy, station.peers)
    averaging.publication(begun)
    publish(station.peers, 2, begun, np.full(size, -3e38), times=2)
    assert averaging.go_on()
    averaging.publication(flatten(station.algorithm.policy))
    publish(station.peers, 2, begun, np.full(size, 3e38))
    assert not averaging.go_on()
    assert np.array_equal(flatten(station.algorithm.policy), begun)


def test_a_newcomer_acts_on_what_is_known_before_it_has_learned(station: Station) -> None:
    begun, size = flatten(station.algorithm.policy), parameters_of(station.algorithm.policy)
    station.step()
    publish(station.peers, 2, begun + 3, np.ones(size), times=2)
    station.wait_until(lambda: station.step() and station.learned_from > 1 and not station.worker.averaging.is_new)
    assert station.algorithm._n_updates == 0
    station.worker.refresh()
    assert flatten(station.worker.actor.policy) == pytest.approx(begun + 3, abs=1e-4)  # and sees as those who know do
    publish(station.peers, 2, begun + 9, np.ones(size))
    station.step()
    assert flatten(station.algorithm.policy)[:size] == pytest.approx(
        begun[:size] + 3, abs=1e-4
    )  # once, until it learns


def test_whoever_has_gone_or_does_not_fit_is_passed_over(station: Station) -> None:
    begun, size = flatten(station.algorithm.policy), parameters_of(station.algorithm.policy)
    averaging = Averaging(station.algorithm.policy, station.peers)
    publish(station.peers, 2, begun[:-1], np.ones(size), times=3)
    publish(station.peers, 3, begun, np.ones(size), times=3)
    del station.peers.policies[3]
    averaging.publication(begun)
    assert not averaging.go_on()
    assert np.array_equal(flatten(station.algorithm.policy), begun)


@pytest.mark.parametrize("actions", [DISCRETE, CONTINUOUS], ids=["discrete", "continuous"])
@pytest.mark.parametrize("row", [row for row in ROWS if row.averages], ids=lambda row: row.name)
def test_after_an_update_it_goes_on_with_what_others_learned(tmp_path: Path, row: Any, actions: Any) -> None:
    if actions == CONTINUOUS and not row.continuous:
        actions = 5
    steps = {} if row.name in ("A2C", "PolicyGradient") else {"n_steps": 32}
    with learning(tmp_path, algorithm=row.name, actions=actions, parameters=steps) as station:
        begun, size = flatten(station.algorithm.policy), parameters_of(station.algorithm.policy)
        publish(station.peers, 2, begun + 3, np.zeros(size), times=FULL_VOICE + 1)
        station.play(70)
        station.wait_until(lambda: (flatten(station.algorithm.policy) - begun)[:size].mean() > 1)
        assert np.array_equal(station.published[0], np.concatenate([begun, np.zeros(size + 2, np.float32)]))
        station.worker.refresh()
        assert (flatten(station.worker.actor.policy) - begun)[:size].mean() > 1


def test_others_are_heard_as_often_as_one_may_publish(tmp_path: Path) -> None:
    with learning(tmp_path, parameters={"n_steps": 16}) as station:
        begun, size = flatten(station.algorithm.policy), parameters_of(station.algorithm.policy)
        station.play(3)
        station.wait_until(lambda: station.published, "what it begins with")
        station.throttled = True
        station.play(80)
        station.wait_until(lambda: station.algorithm._n_updates >= 6, "three updates")
        publish(station.peers, 2, begun + 9, np.zeros(size), times=FULL_VOICE + 1)
        station.play(40)
        assert abs(flatten(station.algorithm.policy) - begun)[:size].max() < 1
        station.throttled = False
        station.play(40)
        station.wait_until(lambda: (flatten(station.algorithm.policy) - begun)[:size].mean() > 0.1, "what others know")


def test_advice_is_taken_from_the_policy_that_is_published_with_more(tmp_path: Path) -> None:
    with learning(tmp_path, actions=DISCRETE, advice_method="intersection") as station:
        policy, size = station.algorithm.policy, parameters_of(station.algorithm.policy)
        begun = flatten(policy)
        policy.action_net.bias.data[1] = 50.0
        leaning = flatten(policy)
        assign(policy, begun)
        publish(station.peers, 2, leaning, np.full(size, 7.0))
        assert station.worker.see(station.somewhere())["advice"] == pytest.approx([0, 1, 0], abs=1e-4)
        station.peers.put(2, leaning)  # of before the agent averaged
        assert station.worker.see(station.somewhere())["advice"] == pytest.approx([1, 1, 1])


def test_those_of_a_run_begin_alike_and_explore_each_by_itself(tmp_path: Path) -> None:
    begun, drawn = [], []
    for number, run in [(1, 1), (2, 1), (3, 2)]:
        with learning(tmp_path / str(number), number=number, run=run, saves=f"agent/{number}", seed=None) as station:
            begun.append(flatten(station.algorithm.policy))
            drawn.append([station.step()["action"] for _ in range(30)])
    assert np.array_equal(begun[0], begun[1])
    assert not np.array_equal(begun[0], begun[2])
    assert drawn[0] != drawn[1]


def test_an_algorithm_that_learns_at_each_step_averages_nothing(tmp_path: Path) -> None:
    with learning(tmp_path, algorithm="DQN") as station:
        assert station.worker.averaging is None
