"""A frozen agent advises exactly as it acted when it was saved, whatever algorithm it learned with; or it is said why not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch as th

from agents_app.algorithms.advice import neutral_advice
from agents_app.algorithms.registry import get_row
from envs_app.execution.frozen import FrozenSpec
from envs_app.execution.saves import SaveStore
from envs_app.execution.storage import Folder
from tests.algorithms.specs import CONTINUOUS, DISCRETE, OBSERVATIONS, make_spec
from tests.execution.station import Station
from tests.execution.test_advisors import leaning

EVERY = [
    *((name, DISCRETE) for name in ("PPO", "A2C", "TRPO", "PolicyGradient", "BDPI", "DQN", "QR-DQN")),
    *((name, CONTINUOUS) for name in ("PPO", "SAC", "TD3")),
]


def shelf(folder: Path) -> Folder:
    """Where both agents save."""
    return Folder(folder / "saves")


def taught(folder: Path, algorithm: str, actions: Any, **fields: Any) -> FrozenSpec:
    """An agent that has learned a little, and was saved."""
    facts = {
        "algorithm": algorithm,
        "actions": actions,
        "parameters": {"net_arch": "9"},
        "seed": 5,
        "saves": "old/1",
    } | fields
    with Station(folder / "old", storage=shelf(folder), advice_method="none", **facts) as station:
        station.play(70)
        station.wait_until(lambda: station.algorithm._n_updates > 0)
    return FrozenSpec("old dog", station.worker.spec.agent, station.worker.spec.saves)


def advised_by(folder: Path, frozen: FrozenSpec, actions: Any = DISCRETE, **fields: Any) -> Station:
    """A PPO learner."""
    fields = {"advice_method": "intersection", "actions": actions} | fields
    return Station(folder / "young", storage=shelf(folder), advisor=frozen, **fields)


def advice_at(station: Station, obs: Any) -> np.ndarray:
    """What the advisor says there."""
    return station.worker.see(obs)["advice"]


def of_the_zip(folder: Path, frozen: FrozenSpec) -> Any:
    """The stock model of the save, as somebody who knows no Shepherd loads it."""
    chosen = SaveStore(shelf(folder), frozen.saves).choose(frozen.rule)
    assert chosen is not None
    return get_row(frozen.agent.algorithm).load().load(chosen.model, device="cpu")


@pytest.mark.parametrize(("algorithm", "actions"), EVERY, ids=str)
def test_it_advises_exactly_as_the_saved_model_acts(tmp_path: Path, algorithm: str, actions: Any) -> None:
    frozen = taught(tmp_path, algorithm, actions)
    model = of_the_zip(tmp_path, frozen)
    with advised_by(tmp_path, frozen, actions) as station:
        assert station.worker.status()["advisors"] == ["old dog"]
        for _ in range(5):
            obs = station.somewhere()
            known = expected(model, np.asarray(obs))
            assert advice_at(station, obs)[: known.size] == pytest.approx(known, abs=2e-5)


def expected(model: Any, obs: np.ndarray) -> np.ndarray:
    """Probabilities, or means and deviations, of the model; of SAC and TD3, which have none of actions, the greedy action."""
    best = model.predict(obs, deterministic=True)[0]
    if hasattr(model, "exploration_rate"):
        return (1 - model.exploration_rate) * np.eye(DISCRETE)[int(best)] + model.exploration_rate / DISCRETE
    if not hasattr(model.policy, "get_distribution"):
        return best
    with th.no_grad():
        distribution = model.policy.get_distribution(model.policy.obs_to_tensor(obs)[0]).distribution
        if model.action_space.shape:
            return th.cat([distribution.mean, distribution.stddev], -1)[0].numpy()
        return distribution.probs[0].numpy()


@pytest.mark.parametrize("kind", ["discrete", "image", "dict"])
def test_whatever_it_looks_at(tmp_path: Path, kind: str) -> None:
    facts: dict[str, Any] = {"observations": OBSERVATIONS[kind], "parameters": {}}
    frozen = taught(tmp_path, "A2C", DISCRETE, **facts)
    with advised_by(tmp_path, frozen, **facts) as station:
        advice = advice_at(station, station.somewhere())
        assert advice.sum() == pytest.approx(1.0)
        assert {answer["k"] for answer in station.play(40)} == {"answer"}


def test_it_advises_beside_the_peers_or_in_their_place(tmp_path: Path) -> None:
    frozen = taught(tmp_path, "PPO", DISCRETE)
    for beside in (True, False):
        with advised_by(tmp_path, frozen, peers_advise=beside) as station:
            station.peers.put(2, leaning(station, 1, 9.0))
            obs = station.somewhere()
            sure = [advice_at(station, obs)[1] > 0.99 for _ in range(60)]
            assert any(sure) == beside
            assert not all(sure)
            assert station.worker.status()["advisors"] == (["old dog", 2] if beside else ["old dog"])


def test_the_best_of_all_may_be_it(tmp_path: Path) -> None:
    frozen = taught(tmp_path, "PPO", DISCRETE)  # returns of 10
    with advised_by(tmp_path, frozen, advisors="best") as station:
        for returns, best in ((9.0, ["old dog"]), (11.0, [2])):
            station.peers.put(2, leaning(station, 1, 9.0), returns)
            assert station.worker.status()["advisors"] == best


def test_its_best_save_may_advise(tmp_path: Path) -> None:
    frozen = taught(tmp_path, "PPO", DISCRETE, save_interval=20)
    assert len(SaveStore(shelf(tmp_path), frozen.saves).names()) > 1
    frozen.rule = "best"
    model = of_the_zip(tmp_path, frozen)
    with advised_by(tmp_path, frozen) as station:
        obs = station.somewhere()
        assert advice_at(station, obs) == pytest.approx(expected(model, np.asarray(obs)), abs=2e-5)


def test_to_load_it_changes_nothing_that_the_learner_draws(tmp_path: Path) -> None:
    frozen = taught(tmp_path, "DQN", DISCRETE)
    taken = []
    for advisor in (frozen, None):
        young: dict[str, Any] = {
            "advice_method": "shaping",
            "advisor": advisor,
            "seed": 4,
            "saves": f"young/{len(taken)}",
        }
        with Station(tmp_path / str(len(taken)), storage=shelf(tmp_path), **young) as station:
            obs = station.somewhere()
            taken.append([station.step(obs=obs)["action"] for _ in range(25)])
    assert taken[0] == taken[1]


UNFITTING: dict[str, tuple[dict[str, Any], str]] = {
    "it has not learned": ({}, "it has no save yet"),
    "other actions": ({"actions": 4}, "its actions or observations are others now"),
    "no probabilities": ({"algorithm": "ARS"}, "ARS gives no probabilities to advise with"),
}


@pytest.mark.parametrize("reason", UNFITTING)
def test_one_that_cannot_advise_is_said_and_passed_over(tmp_path: Path, reason: str) -> None:
    fields, sentence = UNFITTING[reason]
    frozen = FrozenSpec("old dog", make_spec(**fields), "nothing/1")
    with advised_by(tmp_path, frozen) as station:
        assert np.array_equal(advice_at(station, station.somewhere()), neutral_advice(station.worker.action_space))
        assert [report["summary"] for report in station.told("error")] == [f"old dog does not advise: {sentence}"]
        assert {answer["k"] for answer in station.play(40)} == {"answer"}


def test_nor_one_whose_save_is_of_another_network(tmp_path: Path) -> None:
    frozen = taught(tmp_path, "PPO", DISCRETE)
    frozen.agent.parameters["net_arch"] = "5"
    with advised_by(tmp_path, frozen) as station:
        (report,) = station.told("error")
        assert "cannot be loaded" in report["summary"]
        assert station.step()["k"] == "answer"
