"""Acting in NumPy, in process: what is recorded is what the learner's own policy says."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th

from agents_app.algorithms.builder import build
from experiments.acting import Acting, act_in_numpy
from experiments.advisors import uniform
from experiments.in_process import Advised, spec_of


@pytest.mark.parametrize("algorithm", ["PPO", "PolicyGradient"])
@pytest.mark.parametrize("environment", ["CartPole-v1", "Pendulum-v1"])
@pytest.mark.parametrize(("advised", "normalised"), [(False, False), (True, False), (True, True)])
def test_the_record_is_what_the_learners_policy_says_after_updates_too(
    algorithm: str, environment: str, advised: bool, normalised: bool
) -> None:
    env: gym.Env = gym.make(environment)
    fields = {"advice_method": "intersection"} if advised else {}
    if advised:
        env = Advised(env, uniform(env.action_space))
    parameters: dict[str, Any] = {"n_steps": 64, "learning_rate": 1e-2, "normalize_observations": normalised}
    learner = build(spec_of(env, algorithm, parameters, **fields), env, seed=3)
    act_in_numpy(learner)
    assert isinstance(learner.policy.tape, Acting)
    learner.learn(256)
    assert not normalised or learner.normaliser.statistics["count"] >= 256
    check_record(learner)


def check_record(learner: Any) -> None:
    """One more rollout, whose record is compared with the policy as it is."""
    _, callback = learner._setup_learn(10_000, None, False)
    learner.collect_rollouts(learner.env, callback, learner.rollout_buffer, n_rollout_steps=64)
    data = next(learner.rollout_buffer.get(None))
    actions = data.actions.long().flatten() if isinstance(learner.action_space, gym.spaces.Discrete) else data.actions
    with th.no_grad():
        values, log_prob, _ = learner.policy.evaluate_actions(data.observations, actions)
    np.testing.assert_allclose(log_prob.numpy(), data.old_log_prob.numpy(), atol=2e-5)
    np.testing.assert_allclose(values.numpy().ravel(), data.old_values.numpy().ravel(), atol=2e-4, rtol=1e-4)


def test_algorithms_off_the_policy_act_as_they_do() -> None:
    env = gym.make("CartPole-v1")
    learner = build(spec_of(env, "DQN", {}), env, seed=0)
    act_in_numpy(learner)
    assert getattr(learner.policy, "tape", None) is None
