"""Observations of any scale: the networks see them at mean 0 and deviation 1, and the statistics go where the weights go."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th

from agents_app.algorithms import builder
from agents_app.algorithms.actor import advice_weights, advising_policy
from agents_app.algorithms.normalising import BORROWED, Normaliser
from agents_app.algorithms.peer import Peer
from agents_app.algorithms.registry import ROWS, get_row
from agents_app.algorithms.spec import AgentSpec
from agents_app.algorithms.weights import assign, flatten
from tests.algorithms.building import built
from tests.algorithms.specs import CONTINUOUS, DISCRETE, IMAGE, actions_of, make_spec

ON = {"normalize_observations": True}
WIDE = [[3], -1e6, 1e6]
EVERY = [(row.name, actions) for row in ROWS if row.normalises for actions in actions_of(row)]


def far(count: int, seed: int = 0) -> np.ndarray:
    """Observations that no network could learn from: large, far from zero, one of them constant. (N, 3)."""
    rng = np.random.default_rng(seed)
    return (rng.normal(size=(count, 3)) * [1000.0, 0.01, 0.0] + [3000.0, -1.0, 7.0]).astype(np.float32)


class Far(gym.Env[np.ndarray, Any]):
    """Has such observations; a step brings 1, and every hundredth ends an episode."""

    observation_space = gym.spaces.Box(-1e6, 1e6, (3,))

    def __init__(self, actions: Any) -> None:
        self.action_space = make_spec("PPO", actions, WIDE).actions()
        self.observations, self.steps = far(1000), 0

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[np.ndarray, dict[str, Any]]:
        super().reset(seed=seed)
        return self.observations[self.steps % 1000], {}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        self.steps += 1
        return self.observations[self.steps % 1000], 1.0, self.steps % 100 == 0, False, {}

    def action_masks(self) -> np.ndarray:
        """For MaskablePPO: all may be chosen."""
        return np.ones(DISCRETE, bool)


def normalising(name: str, actions: Any, seed: int = 1, **fields: Any) -> tuple[AgentSpec, Any]:
    """An algorithm that has seen 500 observations."""
    spec = make_spec(name, actions, WIDE, ON, **fields)
    algorithm = built(spec, seed)
    algorithm.normaliser.observe(far(500))
    return spec, algorithm


def test_the_statistics_are_those_of_all_batches_together() -> None:
    rows, normaliser = far(300), Normaliser(3)
    for first, last in ((0, 1), (1, 100), (100, 300)):
        normaliser.observe(rows[first:last])
    np.testing.assert_allclose(normaliser.mean, rows.astype(np.float64).mean(0), rtol=1e-6)
    np.testing.assert_allclose(1 / normaliser.scale[:2], rows.astype(np.float64).std(0)[:2], rtol=1e-5)
    seen = normaliser(th.from_numpy(rows)).numpy()
    np.testing.assert_allclose(seen.mean(0), 0.0, atol=1e-3)
    np.testing.assert_allclose(seen.std(0), [1.0, 1.0, 0.0], atol=1e-3)


def test_it_changes_nothing_before_it_has_seen_anything() -> None:
    rows = th.from_numpy(far(5))
    assert th.equal(Normaliser(3)(rows), rows)


@pytest.mark.parametrize(("name", "actions"), [it for it in EVERY if get_row(it[0]).family != "off_policy"])
def test_the_first_update_sees_its_observations_normalised_already(name: str, actions: Any) -> None:
    algorithm = builder.build(make_spec(name, actions, WIDE, ON), Far(actions), 1)
    seen: list[np.ndarray] = []
    algorithm.normaliser.register_forward_hook(lambda _, __, out: seen.append(out.detach().numpy()))
    algorithm.learn(600)
    learned = np.concatenate([batch for batch in seen if len(batch) > 1])
    assert np.abs(learned).max() < 50  # A2C learns from five steps; 3000 as they came
    assert algorithm.normaliser.statistics["count"] == algorithm.num_timesteps  # each once


def test_statistics_that_came_with_the_weights_of_another_last_until_there_are_own(tmp_path: Path) -> None:
    spec, known = normalising("PPO", DISCRETE)
    newcomer = builder.build(spec, known.env, seed=5)
    assert newcomer.normaliser.is_blank
    assign(newcomer.policy, flatten(known.policy))
    builder.export(newcomer, spec, tmp_path / "model.zip")
    restored = builder.build(spec, known.env, seed=6)
    builder.restore(restored, tmp_path / "model.zip")
    for each in (newcomer, restored):
        assert flatten(each.policy) == pytest.approx(flatten(known.policy), rel=1e-6)
        each.normaliser.observe(far(2000, seed=7) * 2)
        np.testing.assert_allclose(each.normaliser.mean, (far(2000, seed=7) * 2).mean(0), rtol=0.05)
        assert each.normaliser.statistics["count"] == 2000 + BORROWED


@pytest.mark.parametrize(("name", "actions"), EVERY)
def test_a_saved_model_is_a_stock_one_that_acts_the_same(name: str, actions: Any, tmp_path: Path) -> None:
    spec, algorithm = normalising(name, actions)
    builder.export(algorithm, spec, tmp_path / "model.zip")
    stock = get_row(name).load().load(tmp_path / "model.zip", device="cpu")
    obs, _ = algorithm.policy.obs_to_tensor(far(40, seed=1))
    with th.no_grad():
        ours = algorithm.policy._predict(obs, deterministic=True)
        theirs = stock.policy._predict(obs, deterministic=True)
    np.testing.assert_allclose(theirs.numpy(), ours.numpy(), atol=1e-3)
    if name in ("PPO", "PolicyGradient", "MaskablePPO"):
        with th.no_grad():
            pair = [it.policy.get_distribution(obs).distribution for it in (algorithm, stock)]
        said = [it.probs if actions == DISCRETE else it.mean for it in pair]
        np.testing.assert_allclose(said[1].numpy(), said[0].numpy(), atol=1e-3)


@pytest.mark.parametrize("layers", ["3", "0"])
@pytest.mark.parametrize("gsde", [True, False])
@pytest.mark.parametrize("name", ["PPO", "A2C", "SAC", "TQC"])
def test_so_is_one_that_explores_by_gsde_or_has_no_layers(name: str, gsde: bool, layers: str, tmp_path: Path) -> None:
    """Which makes the last layer of SAC's actor a stack; as wide as what it sees, it must not be taken for a first one."""
    spec = make_spec(name, CONTINUOUS, WIDE, ON | {"use_sde": gsde, "net_arch": layers})
    algorithm = built(spec, 1)
    algorithm.normaliser.observe(far(500))
    builder.export(algorithm, spec, tmp_path / "model.zip")
    stock = get_row(name).load().load(tmp_path / "model.zip", device="cpu")
    acted, wanted = (it.predict(far(40, seed=1), deterministic=True)[0] for it in (stock, algorithm))
    np.testing.assert_allclose(acted, wanted, atol=1e-3)


@pytest.mark.parametrize(("name", "actions"), EVERY)
def test_a_save_brings_back_weights_and_statistics_to_the_bit(name: str, actions: Any, tmp_path: Path) -> None:
    spec, algorithm = normalising(name, actions)
    builder.export(algorithm, spec, tmp_path / "model.zip")
    other = builder.build(spec, algorithm.env, seed=5)
    builder.restore(other, tmp_path / "model.zip")
    assert np.array_equal(flatten(other.policy), flatten(algorithm.policy))
    for each in (algorithm, other):
        each.normaliser.observe(far(100, seed=2))
    assert np.array_equal(flatten(other.policy), flatten(algorithm.policy))


@pytest.mark.parametrize(("name", "actions"), [("PPO", DISCRETE), ("PPO", CONTINUOUS), ("DQN", DISCRETE)])
def test_the_actor_and_a_peer_see_with_the_statistics_of_whose_policy_it_is(name: str, actions: Any) -> None:
    spec, algorithm = normalising(name, actions, advice_method="intersection")
    stranger = builder.build(spec, algorithm.env, seed=9)
    peer = Peer(advising_policy(stranger))
    assign(peer.policy, advice_weights(algorithm.policy))
    actor = builder.family_of(spec).make_actor(stranger)
    if name == "PPO":
        actor.update(flatten(algorithm.policy))
    for obs in far(10, seed=3):
        with th.no_grad():
            wanted = algorithm.policy.get_distribution(th.from_numpy(obs[None])).distribution
        if actions == DISCRETE:
            np.testing.assert_allclose(peer.probabilities(obs), wanted.probs[0].numpy(), atol=1e-5)
        else:
            np.testing.assert_allclose(peer.gaussian(obs)[0], wanted.mean[0].numpy(), atol=1e-5)
        if name == "PPO":
            best = wanted.probs[0].argmax() if actions == DISCRETE else wanted.mean[0].clamp(-2, 2)
            np.testing.assert_allclose(actor.exploit(obs, None, None)[0], best.numpy(), atol=1e-5)


@pytest.mark.parametrize(("name", "observations"), [("PPO", 5), ("PPO", IMAGE), ("CrossQ", WIDE), ("BDPI", WIDE)])
def test_what_has_a_scale_already_is_left_alone(name: str, observations: Any) -> None:
    algorithm = built(make_spec(name, actions_of(get_row(name))[0], observations, ON))
    assert not hasattr(algorithm, "normaliser")
