"""An execution goes on from the last save, draws its own random numbers, and says what it does."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch as th
from stable_baselines3 import DQN

from agents_app.algorithms import builder
from agents_app.algorithms.weights import flatten
from envs_app.execution import learner
from envs_app.execution.learner import Diverged
from envs_app.execution.saves import MODEL
from envs_app.execution.turns import PATIENCE, Turns
from tests.algorithms.building import tensors
from tests.algorithms.specs import CONTINUOUS, DISCRETE
from tests.execution.station import Station

ON_AND_OFF = [
    ("PPO", DISCRETE),
    ("A2C", CONTINUOUS),
    ("TRPO", DISCRETE),
    ("RecurrentPPO", DISCRETE),
    ("DQN", DISCRETE),
    ("QR-DQN", DISCRETE),
    ("SAC", CONTINUOUS),
    ("TD3", CONTINUOUS),
    ("CrossQ", CONTINUOUS),
    ("ARS", DISCRETE),
    ("BDPI", DISCRETE),
    ("PolicyGradient", CONTINUOUS),
]


def actions(folder: Path, steps: int = 40, **options: Any) -> list[Any]:
    """What an execution does at the same place, again and again."""
    with Station(folder, **options) as station:
        return [station.step(obs=2)["action"] for _ in range(steps)]


def test_one_that_waits_for_its_turn_saves_at_once_when_it_shall_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SHEPHERD_TRAINERS", "1")
    (tmp_path / "turns").mkdir()
    other = Turns(tmp_path / "turns", 1)
    other.take()
    with Station(tmp_path, turns=str(tmp_path / "turns"), parameters={"n_steps": 128}) as station:
        station.play(135)
        station.wait_until(lambda: station.worker.learner.updating, "the learner to wait for its turn")
        assert station.worker.stop(PATIENCE / 2)
        chosen = station.worker.store.choose("latest")
    other.give_back()
    assert chosen is not None
    assert (chosen.meta.steps, chosen.meta.updates) == (128, 0)


class TestRandomness:
    @pytest.mark.parametrize(("algorithm", "kind"), [("PPO", DISCRETE), ("DQN", DISCRETE), ("SAC", CONTINUOUS)])
    def test_two_executions_act_differently(self, tmp_path: Path, algorithm: str, kind: Any) -> None:
        facts: dict[str, Any] = {"algorithm": algorithm, "actions": kind, "observations": 5, "seed": 5, "steps": 15}
        one = actions(tmp_path / "one", number=1, **facts)
        assert one != actions(tmp_path / "two", number=2, **facts)
        assert one == actions(tmp_path / "same", number=1, **facts)

    def test_without_a_seed_no_two_executions_act_alike(self, tmp_path: Path) -> None:
        taken = [actions(tmp_path / str(n), observations=5, seed=None) for n in range(2)]
        assert taken[0] != taken[1]

    def test_they_begin_with_different_weights(self, tmp_path: Path) -> None:
        with Station(tmp_path / "one", number=1) as one, Station(tmp_path / "two", number=2) as two:
            assert not np.array_equal(flatten(one.algorithm.policy), flatten(two.algorithm.policy))


class TestRestore:
    @pytest.mark.parametrize(("algorithm", "kind"), ON_AND_OFF)
    def test_the_next_execution_goes_on_where_the_last_one_ended(
        self, tmp_path: Path, algorithm: str, kind: Any
    ) -> None:
        with Station(tmp_path, algorithm=algorithm, actions=kind) as first:
            first.play(80)
        with Station(tmp_path, uid="second", number=2, algorithm=algorithm, actions=kind, learning=False) as second:
            old, new = first.algorithm, second.algorithm
            assert new.num_timesteps == old.num_timesteps > 0
            assert new._n_updates == old._n_updates > 0
            assert second.worker.counters.episodes == first.worker.counters.episodes == 8
            assert list(second.worker.counters.returns) == list(first.worker.counters.returns)
            before, after = tensors(old.get_parameters()), tensors(new.get_parameters())
            assert len(before) == len(after) > 0
            assert all(th.equal(x, y) for x, y in zip(before, after, strict=True))
            assert not second.told("error")

    def test_the_optimiser_is_restored_too(self, tmp_path: Path) -> None:
        with Station(tmp_path) as first:
            first.play(80)
        with Station(tmp_path, number=2, learning=False) as second:
            old, new = (s.algorithm.policy.optimizer.state_dict()["state"] for s in (first, second))
            assert old
            assert all(th.equal(old[key]["exp_avg"], new[key]["exp_avg"]) for key in old)

    def test_the_entropy_coefficient_of_sac_is_restored(self, tmp_path: Path) -> None:
        facts: dict[str, Any] = {"algorithm": "SAC", "actions": CONTINUOUS}
        with Station(tmp_path, **facts) as first:
            first.play(80)
        with Station(tmp_path, number=2, learning=False, **facts) as second:
            assert th.equal(first.algorithm.log_ent_coef, second.algorithm.log_ent_coef)
            assert second.algorithm.log_ent_coef.item() != 0.0

    @pytest.mark.parametrize(("before", "after"), [("0.1", "0.5"), ("auto", "0.1"), ("0.1", "auto")])
    def test_an_entropy_coefficient_that_was_changed_counts(self, tmp_path: Path, before: str, after: str) -> None:
        facts: dict[str, Any] = {"algorithm": "SAC", "actions": CONTINUOUS}
        with Station(tmp_path, **facts, parameters={"ent_coef": before}) as first:
            first.play(80)
        with Station(tmp_path, number=2, learning=False, **facts, parameters={"ent_coef": after}) as second:
            assert not second.told("error")
            assert second.algorithm.num_timesteps == first.algorithm.num_timesteps
            if after == "auto":
                assert second.algorithm.ent_coef_optimizer is not None
            else:
                assert second.algorithm.ent_coef_tensor.item() == pytest.approx(float(after))
        with Station(tmp_path, number=3, **facts, parameters={"ent_coef": after}) as third:
            third.play(80)
            third.wait_until(lambda: third.algorithm._n_updates > first.algorithm._n_updates)

    @pytest.mark.parametrize("changed", [{"rms_prop_eps": 0.01}, {"use_rms_prop": False}], ids=str)
    def test_settings_of_the_optimiser_are_those_of_now(self, tmp_path: Path, changed: dict[str, Any]) -> None:
        with Station(tmp_path, algorithm="A2C") as first:
            first.play(40)
        with Station(tmp_path, number=2, algorithm="A2C", parameters=changed) as second:
            assert np.array_equal(flatten(second.algorithm.policy), flatten(first.algorithm.policy))
            optimiser: Any = second.algorithm.policy.optimizer
            assert optimiser.param_groups[0]["eps"] == pytest.approx(changed.get("rms_prop_eps", 1e-5))
            assert bool(optimiser.state) == ("rms_prop_eps" in changed)
            second.play(40)
            second.wait_until(lambda: second.algorithm._n_updates > first.algorithm._n_updates)

    def test_the_slow_copy_of_the_network_is_renewed_however_short_executions_are(self, tmp_path: Path) -> None:
        facts: dict[str, Any] = {"algorithm": "DQN", "parameters": {"target_update_interval": 60, "learning_starts": 4}}
        targets = []
        for number in range(1, 4):
            with Station(tmp_path, number=number, **facts) as station:
                station.play(40)
                station.wait_until(lambda: station.learned_from >= 39 * number)  # noqa: B023
            targets.append(flatten(station.algorithm.q_net_target))
        assert not np.array_equal(targets[0], targets[1])

    def test_a_model_from_it_begins_to_learn_as_the_first_one_did(self, tmp_path: Path) -> None:
        facts: dict[str, Any] = {"algorithm": "DQN", "parameters": {"learning_starts": 16}}
        for number in (1, 2):
            with Station(tmp_path, number=number, **facts) as station:
                station.play(80)
        chosen = station.worker.store.choose("latest")
        assert chosen is not None
        assert station.algorithm.learning_starts > 16
        assert DQN.load(chosen.model, device="cpu").learning_starts == 16

    def test_a_save_that_does_not_fit_leaves_nothing_behind(self, tmp_path: Path) -> None:
        with Station(tmp_path, parameters={"net_arch": "8"}) as first:
            first.play(80)
        with Station(tmp_path, number=2, learning=False, parameters={"net_arch": "8,8"}) as second:
            assert second.told("error")
            fresh = Station(tmp_path / "fresh", number=2, learning=False, parameters={"net_arch": "8,8"})
            with fresh:
                assert np.array_equal(flatten(second.algorithm.policy), flatten(fresh.algorithm.policy))

    def test_ars_goes_on_from_what_it_learned(self, tmp_path: Path) -> None:
        with Station(tmp_path, algorithm="ARS") as first:
            for number in range(10):  # it compares returns
                first.play(5, length=5, reward=float(number))
        with Station(tmp_path, number=2, algorithm="ARS") as second:
            assert th.equal(second.algorithm.weights, th.from_numpy(flatten(first.algorithm.policy)))
            assert second.algorithm.weights.any()

    def test_exploration_goes_on_where_it_was(self, tmp_path: Path) -> None:
        facts: dict[str, Any] = {"algorithm": "DQN", "parameters": {"total_timesteps": 400}}
        with Station(tmp_path, **facts) as first:
            first.play(80)
            first.wait_until(lambda: first.learned_from >= 79)
        with Station(tmp_path, number=2, **facts) as second:
            assert second.algorithm.exploration_rate == pytest.approx(first.algorithm.exploration_rate)
            assert second.algorithm.exploration_rate < 1.0
            assert second.worker.actor.algorithm.exploration_rate == second.algorithm.exploration_rate

    def test_off_the_policy_it_acts_as_it_learned_to_and_fills_its_buffer_first(self, tmp_path: Path) -> None:
        facts: dict[str, Any] = {"algorithm": "SAC", "actions": CONTINUOUS, "observations": 5}
        with Station(tmp_path, **facts) as first:
            first.play(60)
        with Station(tmp_path, number=2, **facts) as second:
            updates = second.algorithm._n_updates
            assert second.algorithm.learning_starts == 16 + second.algorithm.num_timesteps
            assert second.worker.actor.algorithm.learning_starts == 16 < second.algorithm.num_timesteps
            second.play(10)
            assert second.algorithm._n_updates == updates
            second.play(60)
            second.wait_until(lambda: second.algorithm._n_updates > updates)

    def test_a_damaged_save_is_passed_over_for_the_one_before(self, tmp_path: Path) -> None:
        with Station(tmp_path, save_interval=32) as first:
            first.play(100)
        newest, before = first.worker.store.names()[:2]
        (tmp_path / "saves" / "agent" / "1" / newest / MODEL).write_bytes(b"half a model")
        with Station(tmp_path, number=2, learning=False) as second:
            meta = first.worker.store.meta(before)
            assert meta is not None
            assert second.algorithm.num_timesteps == meta.steps > 0

    def test_a_save_of_another_network_is_passed_over_and_said(self, tmp_path: Path) -> None:
        with Station(tmp_path) as first:
            first.play(80)
        with Station(tmp_path, number=2, parameters={"net_arch": "16"}) as second:
            assert second.algorithm.num_timesteps == 0
            [error] = second.told("error")
            assert "does not fit" in error["summary"]
            assert "Traceback" in error["traceback"]
            second.play(40)

    def test_it_may_start_from_the_best_save(self, tmp_path: Path) -> None:
        with Station(tmp_path, save_interval=32) as first:
            first.play(64, reward=1.0)
            first.wait_until(lambda: len(first.worker.store.names()) == 1)
            first.play(640, reward=-1.0, length=5)
        best = max((meta for _, meta in first.worker.store.metas()), key=lambda meta: meta.mean_return or -1e9)
        for rule, steps in (("best", best.steps), ("latest", first.algorithm.num_timesteps)):
            with Station(tmp_path, number=2, start_from=rule, learning=False) as second:
                assert second.algorithm.num_timesteps == steps


class TestSaving:
    def test_saves_are_made_at_intervals_and_at_the_end(self, tmp_path: Path) -> None:
        with Station(tmp_path, save_interval=64) as station:
            station.play(140)
            station.wait_until(lambda: len(station.told("saved")) == 2)
        assert len(station.told("saved")) == 3
        assert [meta.steps for _, meta in station.worker.store.metas()] == [station.learned_from, 128, 64]

    def test_a_save_can_be_asked_for(self, tmp_path: Path) -> None:
        with Station(tmp_path) as station:
            station.play(20)
            station.worker.save_now(7)
            station.wait_until(lambda: station.told("save_answered") == [{"k": "save_answered", "ticket": 7}])
            assert station.told("saved")

    def test_nothing_is_saved_when_nothing_was_learned(self, tmp_path: Path) -> None:
        with Station(tmp_path) as station:
            station.worker.save_now()
            station.step()
        assert station.worker.store.names() == []

    def test_what_was_restored_is_not_saved_again(self, tmp_path: Path) -> None:
        with Station(tmp_path) as first:
            first.play(40)
        with Station(tmp_path, number=2):
            pass
        assert len(first.worker.store.names()) == 1

    def test_a_full_disk_is_said_and_stops_nobody(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def refuse(*arguments: Any) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

        monkeypatch.setattr(builder, "export", refuse)
        with Station(tmp_path, save_interval=32) as station:
            station.play(100)
            station.wait_until(lambda: station.told("error"))
            assert "No space left" in station.told("error")[0]["summary"]
            assert "No space left" in station.worker.status()["save_error"]
            monkeypatch.undo()
            station.play(100)
            station.wait_until(lambda: station.told("saved"))
            assert station.worker.status()["save_error"] == ""

    def test_what_could_not_be_saved_is_saved_when_there_is_room(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def refuse(*arguments: Any) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

        with Station(tmp_path) as station:
            station.play(70)
            monkeypatch.setattr(builder, "export", refuse)
            station.worker.set_learning(False)
            station.wait_until(lambda: station.told("error"))
            monkeypatch.undo()
            station.worker.save_now(7)
            station.wait_until(lambda: station.told("save_answered"))
            assert station.told("saved")


class TestFailure:
    def test_an_algorithm_that_fails_is_reported_with_its_traceback(self, tmp_path: Path) -> None:
        with Station(tmp_path) as station:

            def train() -> None:
                raise FloatingPointError("the algorithm is broken")

            station.algorithm.train = train
            with pytest.raises(AssertionError, match="the algorithm is broken"):
                station.play(100)
            assert "Traceback" in (station.worker.failure or "")

    @pytest.mark.parametrize(("algorithm", "kind"), [("PPO", DISCRETE), ("DQN", DISCRETE), ("TD3", CONTINUOUS)])
    def test_weights_that_are_not_finite_are_never_saved(self, tmp_path: Path, algorithm: str, kind: Any) -> None:
        with Station(tmp_path, algorithm=algorithm, actions=kind) as station:
            station.play(40)
            station.hold_learner()
            with th.no_grad():
                next(station.algorithm.policy.parameters()).fill_(float("nan"))
        assert Diverged.__name__ in (station.worker.failure or "")
        assert station.worker.store.names() == []

    @pytest.mark.parametrize("advice", ["none", "intersection"])
    @pytest.mark.parametrize("follow_seconds", [0.0, 1e9], ids=["amid an update", "after it"])
    def test_nobody_acts_with_weights_that_are_not_finite(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, advice: str, follow_seconds: float
    ) -> None:
        monkeypatch.setattr(learner, "FOLLOW_SECONDS", follow_seconds)
        with Station(tmp_path, advice_method=advice, parameters={"learning_rate": 1e38}) as station:
            with pytest.raises(AssertionError, match=r"no longer finite|Expected parameter"):
                station.play(400)
            handed_over = station.worker.learner.published
        assert handed_over is None or np.isfinite(handed_over).all()
        if advice != "none":
            assert Diverged.__name__ in (station.worker.failure or "")

    def test_bad_parameters_are_said_at_once(self, tmp_path: Path) -> None:
        with pytest.raises((ValueError, TypeError, AssertionError)):
            Station(tmp_path, algorithm="TD3", actions=CONTINUOUS, parameters={"action_noise": "loud"})


def test_the_status_says_what_it_does(tmp_path: Path) -> None:
    with Station(tmp_path) as station:
        station.play(60)
        station.wait_until(lambda: station.learned_from >= 59)
        status = station.worker.status()
    assert status["steps"] == 66  # 60 outcomes, and a first observation per episode
    assert status["episodes"] == 6
    assert status["updates"] == 2  # epochs, of one rollout of 32
    assert status["mean_return"] == 10.0
    assert status["learning"] is True
    assert status["advisors"] == []
