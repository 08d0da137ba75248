"""Features of actions: what is learned of one action tells of those like it, and saved models are stock ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch as th

from agents_app.algorithms import builder
from agents_app.algorithms.action_features import ScoresFeatures
from agents_app.algorithms.masks import with_mask
from agents_app.algorithms.registry import ROWS, get_row
from agents_app.algorithms.small_actor import SmallActor
from agents_app.algorithms.small_net import SmallNet
from agents_app.algorithms.spec import AgentSpec
from agents_app.algorithms.weights import assign, flatten
from tests.algorithms.building import built, environment, some, stack, tensors
from tests.algorithms.specs import make_spec
from tests.execution.station import Station

FEATURES = [[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]]
SCORING = [row.name for row in ROWS if row.scores]


def scoring(name: str = "PPO", **fields: Any) -> AgentSpec:
    """A small agent that knows what its three actions are like."""
    return make_spec(name, action_features=FEATURES, **fields)


def scores(algorithm: Any, observations: list[Any]) -> th.Tensor:
    """Logits, values or quantiles, (B, ...)."""
    policy, obs = algorithm.policy, stack(observations)
    with th.no_grad():
        if hasattr(policy, "action_net"):
            return policy.get_distribution(obs).distribution.logits
        return (policy.q_net if hasattr(policy, "q_net") else policy.quantile_net)(obs)


@pytest.mark.parametrize("outputs", [3, 12])
def test_the_layer_is_the_stock_one_that_it_names(outputs: int) -> None:
    layer = ScoresFeatures(th.tensor(FEATURES), 4, outputs)
    for tensor in layer.parameters():
        th.nn.init.normal_(tensor)
    stock = th.nn.Linear(4, outputs)
    stock.load_state_dict(layer.stock())
    x = th.randn(7, 4)
    th.testing.assert_close(layer(x), stock(x))
    assert th.linalg.matrix_rank(layer.stock()["weight"]) == min(4, 2 * outputs // 3)


@pytest.mark.parametrize("name", SCORING)
def test_every_action_is_as_good_as_the_others_before_it_learns(name: str) -> None:
    spec = scoring(name)
    algorithm = builder.build(spec, environment(spec), 1)
    found = scores(algorithm, some(spec.observations()))
    assert (found == found.flatten()[0]).all()


@pytest.mark.parametrize("name", SCORING)
def test_a_saved_model_is_a_stock_one_that_says_the_same(name: str, tmp_path: Path) -> None:
    spec, path = scoring(name), tmp_path / "model.zip"
    algorithm = taught(spec)
    builder.export(algorithm, spec, path)
    stock = get_row(name).load().load(path, device="cpu")
    observations = some(spec.observations(), 20)
    th.testing.assert_close(scores(stock, observations), scores(algorithm, observations), atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("layers", ["8", "0"])
@pytest.mark.parametrize("name", SCORING)
def test_a_save_brings_back_what_was_learned_and_the_optimiser_to_the_bit(
    name: str, layers: str, tmp_path: Path
) -> None:
    spec = scoring(name, parameters={"normalize_observations": True, "net_arch": layers})
    path = tmp_path / "model.zip"
    algorithm, other = taught(spec), built(spec, seed=2)
    algorithm.normaliser.observe(5.0 + np.random.default_rng(1).random((30, 3)))
    builder.export(algorithm, spec, path)
    stock = get_row(name).load().load(path, device="cpu")
    observations = some(spec.observations(), 20)
    th.testing.assert_close(scores(stock, observations), scores(algorithm, observations), atol=1e-3, rtol=1e-3)
    builder.restore(other, path)
    assert np.array_equal(flatten(other.policy), flatten(algorithm.policy))
    one, two = (tensors(it.get_parameters()) for it in (algorithm, other))
    assert len(one) == len(two)
    assert all(map(th.equal, one, two))


def test_a_stock_model_learns_on_from_a_save(tmp_path: Path) -> None:
    spec, path = scoring(), tmp_path / "model.zip"
    builder.export(taught(spec), spec, path)
    stock = get_row("PPO").load().load(path, env=environment(spec), device="cpu")
    weight = stock.policy.action_net.weight.detach().clone()
    logits = stock.policy.get_distribution(stack(some(spec.observations()))).distribution.logits
    stock.policy.optimizer.zero_grad()
    logits[:, 0].sum().backward()
    stock.policy.optimizer.step()
    assert not th.equal(weight, stock.policy.action_net.weight)


def test_other_features_are_refused(tmp_path: Path) -> None:
    spec, path = scoring(), tmp_path / "model.zip"
    builder.export(built(spec), spec, path)
    more = make_spec(action_features=[[*row, 1.0] for row in FEATURES])
    with pytest.raises(RuntimeError, match="size mismatch"):
        builder.restore(built(more), path)


def test_acting_in_numpy_says_the_same_after_new_weights_too() -> None:
    spec = scoring()
    algorithm = built(spec)
    actor = builder.family_of(spec).make_actor(algorithm)
    assert isinstance(actor, SmallActor)
    net = SmallNet(actor.policy)  # type: ignore[arg-type]
    assign(actor.policy, flatten(built(spec, seed=3).policy) * 1.5)
    for obs in some(spec.observations()):
        said = th.from_numpy(net.act(obs)).log_softmax(-1)
        own = actor.policy.get_distribution(stack([obs])).distribution.logits[0]  # type: ignore[operator]
        th.testing.assert_close(said, own, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("name", SCORING)
def test_what_is_learned_of_some_actions_holds_for_those_like_them(name: str, tmp_path: Path) -> None:
    """Only the first and the fourth of six actions are ever allowed; the first is rewarded."""
    alike = [[1.0, 0.0]] * 3 + [[0.0, 1.0]] * 3
    spec = make_spec(name, 6, action_features=alike, action_masks=True, parameters={"learning_rate": 0.01})
    observations = [obs if name == "MaskablePPO" else with_mask(obs, None, 6) for obs in some(spec.observations(), 10)]
    with Station(tmp_path, agent=spec) as station:
        for _ in range(160):
            action = station.step(mask=[True, False, False, True, False, False])["action"]
            station.step(reward=float(action == 0), terminated=True)
        found = scores(station.algorithm, observations)
        assert station.worker.failure is None
    assert found[..., 1:3].mean() > found[..., 4:].mean()
    th.testing.assert_close(found[..., 1], found[..., 2])


def taught(spec: AgentSpec) -> Any:
    """After a few updates, so that its optimiser knows something."""
    algorithm = built(spec)
    optimizer = algorithm.policy.optimizer
    for _ in range(3):
        found = scores_with_gradients(algorithm, spec)
        optimizer.zero_grad()
        (found[..., 0] ** 2 - found[..., 1]).sum().backward()
        optimizer.step()
    return algorithm


def scores_with_gradients(algorithm: Any, spec: AgentSpec) -> th.Tensor:
    """As `scores`."""
    policy, obs = algorithm.policy, stack(some(spec.observations()))
    if hasattr(policy, "action_net"):
        return policy.get_distribution(obs).distribution.logits + policy.predict_values(obs)
    return (policy.q_net if hasattr(policy, "q_net") else policy.quantile_net)(obs)
