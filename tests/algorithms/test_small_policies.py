"""Off the policy, small networks say in NumPy what they say in torch, and keep saying it while they learn."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch as th
from gymnasium import spaces
from stable_baselines3.common.utils import obs_as_tensor

from agents_app.algorithms.actor import batch
from agents_app.algorithms.advice import with_advice
from agents_app.algorithms.masks import with_mask
from agents_app.algorithms.normalising import Normaliser
from agents_app.algorithms.off_policy import OffPolicyActor
from agents_app.algorithms.small_policies import StandIn, small
from agents_app.algorithms.spec import AgentSpec
from tests.algorithms.building import built, some
from tests.algorithms.specs import CONTINUOUS, DISCRETE, OBSERVATIONS, make_spec

VALUES, ACTORS = ("DQN", "QR-DQN", "BDPI"), ("SAC", "TQC", "TD3", "DDPG")
EVERY = pytest.mark.parametrize("name", [*VALUES, *ACTORS])
NOISE = {"action_noise": "normal 0.2"}
ALLOWED = np.array([True, False, True])


def spec_of(name: str, kind: str = "vector", **fields: Any) -> AgentSpec:
    """An agent that takes advice."""
    noise = NOISE if name in ("TD3", "DDPG") else {}
    actions = DISCRETE if name in VALUES else CONTINUOUS
    facts = {"advice_method": "intersection", "parameters": noise, **fields}
    return make_spec(name, actions, OBSERVATIONS[kind], **facts)


def both(name: str, kind: str = "vector", **fields: Any) -> tuple[Any, Any, list[Any]]:
    """A policy, what stands in for it, and observations."""
    spec = spec_of(name, kind, **fields)
    policy = built(spec).policy
    return policy, small(policy), some(spec.observations(), 20)


def told(policy: Any, obs: Any) -> tuple[np.ndarray, ...]:
    """What peers hear of the policy itself."""
    with th.no_grad():
        it = policy.get_distribution(obs_as_tensor(batch(obs), policy.device)).distribution
    return (it.probs[0].numpy(),) if hasattr(it, "probs") else (it.mean[0].numpy(), it.stddev[0].numpy())


@EVERY
class TestTheSame:
    @pytest.mark.parametrize("kind", ["vector", "discrete"])
    @pytest.mark.parametrize("advice", ["intersection", "none"])
    def test_greedy_actions(self, name: str, kind: str, advice: str) -> None:
        policy, quick, observations = both(name, kind, advice_method=advice)
        for obs in observations:
            expected = policy.predict(batch(obs), deterministic=True)[0]
            given = quick.predict(batch(obs), deterministic=True)[0]
            assert given.shape == expected.shape
            np.testing.assert_allclose(given, expected, atol=1e-5)

    @pytest.mark.parametrize("kind", ["vector", "discrete"])
    def test_what_peers_hear(self, name: str, kind: str) -> None:
        policy, quick, observations = both(name, kind)
        if hasattr(policy, "exploration"):
            policy.exploration.fill_(0.3)
        for obs in observations:
            said = (quick.probabilities(obs),) if name in VALUES else quick.gaussian(obs)
            np.testing.assert_allclose(said, told(policy, obs), atol=1e-5)

    def test_what_peers_hear_of_allowed_actions(self, name: str) -> None:
        if name not in VALUES:
            pytest.skip("only one of n actions can be forbidden")
        policy, quick, observations = both(name, action_masks=True)
        if hasattr(policy, "exploration"):
            policy.exploration.fill_(0.3)
        for obs in (with_mask(obs, ALLOWED, 3) for obs in observations):
            said = quick.probabilities(obs)
            assert said[1] == 0
            np.testing.assert_allclose(said, told(policy, obs)[0], atol=1e-5)

    def test_after_the_weights_have_changed(self, name: str) -> None:
        policy, quick, observations = both(name)
        with th.no_grad():
            for parameter in policy.parameters():
                parameter.mul_(-1.5)
        for obs in observations:
            expected = policy.predict(batch(obs), deterministic=True)[0]
            np.testing.assert_allclose(quick.predict(batch(obs), deterministic=True)[0], expected, atol=1e-5)

    def test_an_execution_acts_with_it_on_the_learners_weights(self, name: str) -> None:
        spec = spec_of(name)
        model = built(spec)
        actor = OffPolicyActor(model)
        assert isinstance(actor.algorithm.policy, StandIn)
        with th.no_grad():
            for parameter in model.policy.parameters():
                parameter.mul_(2.0)
        for obs in some(spec.observations(), 20):
            action, _ = actor.exploit(obs, None, None)
            np.testing.assert_allclose(action, model.predict(obs, deterministic=True)[0], atol=1e-5)


@pytest.mark.parametrize("name", ["DQN", "QR-DQN", *ACTORS])
def test_with_normalised_observations(name: str) -> None:
    spec = spec_of(name)
    model = built(replace(spec, parameters=spec.parameters | {"normalize_observations": True}))
    normaliser: Normaliser = model.normaliser
    quick = small(model.policy)
    normaliser.observe(np.random.default_rng(1).normal(3.0, 5.0, (50, 3)))
    for obs in some(spec.observations(), 20):
        expected = model.policy.predict(batch(obs), deterministic=True)[0]
        np.testing.assert_allclose(quick.predict(batch(obs), deterministic=True)[0], expected, atol=1e-5)


@pytest.mark.parametrize("name", ["SAC", "TQC"])
def test_squashed_actions_are_drawn_from_the_same_distribution(name: str) -> None:
    policy, quick, (obs, *_) = both(name)
    np.random.seed(1)
    th.manual_seed(1)
    with th.no_grad():
        expected = policy.predict(np.tile(obs, (4000, 1)))[0]
    given = np.concatenate([quick.predict(batch(obs))[0] for _ in range(4000)])
    assert given.mean(0) == pytest.approx(expected.mean(0), abs=0.1)
    assert given.std(0) == pytest.approx(expected.std(0), rel=0.05)


@pytest.mark.parametrize("name", ["DQN", "QR-DQN"])
def test_forbidden_actions_have_no_chance(name: str) -> None:
    policy, quick, observations = both(name, action_masks=True)
    for obs in (with_mask(obs, ALLOWED, 3) for obs in observations):
        assert quick.predict(batch(obs))[0] == policy.predict(batch(obs), deterministic=True)[0] != 1
        np.testing.assert_allclose(quick.chances(batch(obs), 0.4), policy.chances(batch(obs), 0.4))
        assert quick.chances(batch(obs), 0.4)[0] == pytest.approx(
            [0.2, 0, 0.2] + 0.6 * np.eye(3)[quick.predict(obs)[0][0]]
        )


@pytest.mark.parametrize("method", ["intersection", "reuse"])
def test_bdpi_draws_from_the_same_mixture(method: str) -> None:
    policy, quick, (obs, *_) = both("BDPI", advice_method=method)
    seen = batch(with_advice(with_mask(obs, ALLOWED, 3), np.array([0.1, 0.6, 0.3], np.float32)))
    wide = {key: np.repeat(value, 4000, 0) for key, value in seen.items()}
    np.random.seed(1)
    th.manual_seed(1)
    expected = np.bincount(policy.sample(wide), minlength=3)
    given = np.bincount([quick.sample(seen)[0] for _ in range(4000)], minlength=3)
    assert given / 4000 == pytest.approx(expected / 4000, abs=0.03)
    assert given[1] == 0


@pytest.mark.parametrize(
    "spec",
    [
        spec_of("DQN", "image"),
        spec_of("SAC", "dict"),
        spec_of("SAC", parameters={"use_sde": True}),
        make_spec("CrossQ", CONTINUOUS, advice_method="none"),
        spec_of("BDPI", "dict"),
    ],
    ids=["image", "dict", "gSDE", "CrossQ", "BDPI"],
)
def test_other_networks_are_left_to_torch(spec: AgentSpec) -> None:
    model = built(spec)
    assert small(model.policy) is None
    assert OffPolicyActor(model).algorithm.policy.__class__ is model.policy.__class__
    assert isinstance(model.action_space, spaces.Box | spaces.Discrete)
