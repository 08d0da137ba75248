"""What makes updates cheaper changes nothing in them: shuffling once for an epoch, and judging without torch's checks."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch as th
from stable_baselines3.common.logger import configure
from torch.distributions import Categorical

from agents_app.algorithms.advised import judge
from agents_app.algorithms.minibatches import LARGEST_COPY, slice_minibatches
from tests.algorithms.building import built, some
from tests.algorithms.specs import CONTINUOUS, DISCRETE, OBSERVATIONS, make_spec

VALUES = 20  # of a rollout: not a multiple of the minibatch


def with_rollout(advice: str, actions: Any, observations: Any, name: str = "PPO", **parameters: Any) -> Any:
    """An algorithm that has collected a rollout, always the same one."""
    facts = {"n_steps": VALUES, "batch_size": 8} | parameters
    algorithm = built(make_spec(name, actions, observations, facts, advice_method=advice))
    algorithm.set_logger(configure(None, []))
    buffer, rewards = algorithm.rollout_buffer, np.random.default_rng(3).normal(size=VALUES)
    starts, choices = some(algorithm.observation_space, VALUES), some(algorithm.action_space, VALUES)
    for obs, action, reward in zip(starts, choices, rewards, strict=True):
        shown = {key: np.asarray(part)[None] for key, part in obs.items()} if isinstance(obs, dict) else obs[None]
        buffer.add(shown, np.array([action]), np.array([reward]), np.zeros(1), th.zeros(1), th.full((1,), -1.0))
    buffer.compute_returns_and_advantage(th.zeros(1), np.ones(1))
    return algorithm


def weights_after_updates(algorithm: Any) -> list[th.Tensor]:
    """Two updates, each of several epochs."""
    np.random.seed(5)
    for _ in range(2):
        algorithm.train()
    return list(algorithm.policy.parameters())


@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")  # the last one shall be smaller
@pytest.mark.parametrize("advice", ["none", "intersection"])
@pytest.mark.parametrize("actions", [DISCRETE, CONTINUOUS], ids=["discrete", "continuous"])
def test_sliced_minibatches_make_the_same_update(advice: str, actions: Any) -> None:
    stock, sliced = (with_rollout(advice, actions, OBSERVATIONS["vector"]) for _ in range(2))
    untrained = [parameter.clone() for parameter in sliced.policy.parameters()]
    slice_minibatches(sliced.rollout_buffer)
    assert "get" in vars(sliced.rollout_buffer)
    expected, found = weights_after_updates(stock), weights_after_updates(sliced)
    assert all(map(th.equal, expected, found))
    assert not all(map(th.equal, untrained, found))


@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
@pytest.mark.parametrize("observations", [OBSERVATIONS["vector"], [[64, 64, 64], 0, 255]], ids=["vector", "image"])
def test_trpo_takes_every_second_step_where_observations_are_a_dictionary(observations: Any) -> None:
    algorithm = with_rollout("intersection", DISCRETE, observations, "TRPO", sub_sampling_factor=2)
    slice_minibatches(algorithm.rollout_buffer)
    (whole,) = algorithm.rollout_buffer.get()
    assert {key: len(part) for key, part in whole.observations[::2].items()} == dict.fromkeys(
        whole.observations, VALUES // 2
    )
    before = [parameter.clone() for parameter in algorithm.policy.parameters()]
    algorithm.train()
    after = list(algorithm.policy.parameters())
    assert all(parameter.isfinite().all() for parameter in after)
    assert not all(map(th.equal, before, after))


def test_a_rollout_of_images_is_gathered_by_minibatches_as_before() -> None:
    algorithm = with_rollout("none", DISCRETE, [[64, 64, 64], 0, 255])
    assert algorithm.rollout_buffer.observations.nbytes > LARGEST_COPY
    slice_minibatches(algorithm.rollout_buffer)
    (whole,) = algorithm.rollout_buffer.get()
    assert len(next(iter(algorithm.rollout_buffer.get(8))).actions) == 8
    assert type(whole.observations) is th.Tensor


def test_actions_are_judged_as_by_a_categorical_distribution() -> None:
    start = th.randn((64, 4), generator=th.Generator().manual_seed(1)) * 30
    start[:8, 1] = -1e8  # forbidden
    actions = th.arange(64) % 4
    ours, theirs = start.clone().requires_grad_(), start.clone().requires_grad_()
    log_probs, entropies = judge(ours, actions)
    stock = Categorical(logits=theirs)
    assert th.equal(log_probs, stock.log_prob(actions))
    assert th.equal(entropies, stock.entropy())
    (log_probs + entropies).sum().backward()
    (stock.log_prob(actions) + stock.entropy()).sum().backward()
    assert ours.grad is not None
    assert theirs.grad is not None
    th.testing.assert_close(ours.grad, theirs.grad, rtol=1e-6, atol=1e-7)  # its parts are added in another order
