"""Policy Gradient: it plays whole episodes, follows eq. 2.1 and with advice eq. 3.1, learns, and replays."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.policies import ActorCriticPolicy

from agents_app.algorithms import on_policy
from agents_app.algorithms.advised import AdvisedPolicy
from agents_app.algorithms.mixing import Mixing
from agents_app.algorithms.policy_gradient import PolicyGradient
from agents_app.algorithms.replay import Segment, Tape, TapeClosed
from agents_app.algorithms.small_actor import SmallActor
from envs_app.shepherd_env import ShepherdEnv
from tests.algorithms.games import Advised, Grid, Identity, Point, mean_return


class AdvisedMlp(AdvisedPolicy, ActorCriticPolicy):
    """As the builder makes it."""


EQ_2_1: dict[str, Any] = {"baseline": False, "normalize_advantage": False}
SOME_ADVICE = np.array([0.6, 0.3, 0.1], np.float32)


def make(env: gym.Env, policy: Any = "MlpPolicy", **options: Any) -> PolicyGradient:
    """On the CPU, seeded."""
    given: dict[str, Any] = {"seed": 1, "device": "cpu"}
    return PolicyGradient(policy, env, **given | options)


# --- learning ---
@pytest.mark.parametrize("options", [EQ_2_1, {"n_episodes": 4, "normalize_advantage": True, "baseline_steps": 2}])
def test_it_learns_the_identity_game(options):
    model = make(Identity(), learning_rate=1e-2, gamma=0.0, **options).learn(2500)
    assert mean_return(model, Identity()) >= 9.5  # of 10


def test_it_learns_to_say_a_number():
    model = make(Point(), learning_rate=1e-2, gamma=0.0, n_episodes=4, normalize_advantage=True).learn(4000)
    assert mean_return(model, Point()) > -0.5  # saying 0 brings -3.3


def test_it_learns_cart_pole():
    model = make(gym.make("CartPole-v1"), learning_rate=3e-3).learn(6000)
    assert mean_return(model, gym.make("CartPole-v1"), 10) >= 150


# --- episodes ---
def test_an_update_comes_after_whole_episodes():
    model = make(Identity(), n_episodes=3).learn(31)
    assert (model.num_timesteps, model._n_updates) == (60, 2)


def test_returns_are_discounted_sums_of_the_rewards_to_come():
    model = make(Grid(), gamma=0.9, **EQ_2_1)
    model.learn(1)
    buffer = model.rollout_buffer
    expected, later = [], 0.0
    for reward in buffer.rewards.flatten()[::-1]:
        later = reward + 0.9 * later
        expected.append(later)
    np.testing.assert_allclose(buffer.advantages.flatten(), expected[::-1], rtol=1e-5)


def test_without_a_baseline_what_comes_after_a_truncated_episode_counts_as_nothing():
    model = make(Identity(), **EQ_2_1).learn(30)
    assert model.rollout_buffer.rewards.max() <= 1
    assert all((parameter == 0).all() for parameter in model.policy.value_net.parameters())


def test_with_a_baseline_a_truncated_episode_is_worth_what_it_expects():
    model = make(Identity(), gamma=0.5).learn(1)
    with th.no_grad():
        th.nn.init.constant_(model.policy.value_net.weight, 0.0)
        th.nn.init.constant_(model.policy.value_net.bias, 8.0)
    model.learn(1)
    assert model.rollout_buffer.rewards[-1] >= 4
    assert model.rollout_buffer.rewards[:-1].max() <= 1


def test_an_episode_longer_than_n_steps_is_cut():
    model = make(Identity(), n_steps=4).learn(9)
    assert (model.num_timesteps, model._n_updates) == (10, 3)  # 4, 4, and the 2 to its end


def test_several_environments_at_once_are_refused():
    with pytest.raises(ValueError, match="one environment"):
        PolicyGradient("MlpPolicy", make_vec_env("CartPole-v1", 2))


def test_an_episode_of_one_step_leaves_the_weights_finite():
    model = make(gym.wrappers.TimeLimit(Identity(), 1), normalize_advantage=True).learn(20)
    assert all(parameter.isfinite().all() for parameter in model.policy.parameters())


# --- files ---
@pytest.mark.parametrize("env", [Identity, Point, lambda: Advised(Identity())])
def test_it_comes_back_from_a_file_as_it_was(env, tmp_path: Path):
    policy = AdvisedMlp if isinstance(env(), Advised) else "MlpPolicy"
    model = make(env(), policy, n_episodes=2, baseline_steps=3).learn(50)
    model.save(tmp_path / "model.zip")
    loaded = PolicyGradient.load(tmp_path / "model.zip", env=env(), device="cpu")
    assert (loaded.n_episodes, loaded.baseline_steps, loaded._n_updates) == (2, 3, model._n_updates)
    obs = env().observation_space.sample()
    assert loaded.predict(obs, deterministic=True)[0] == model.predict(obs, deterministic=True)[0]
    loaded.learn(20, reset_num_timesteps=False)
    assert loaded._n_updates > model._n_updates


# --- advice ---
@pytest.mark.parametrize("env", [Identity, Point])
def test_neutral_advice_changes_nothing_to_the_bit(env):
    plain, advised = make(env()).learn(60), make(Advised(env()), AdvisedMlp).learn(60)
    for ours, theirs in zip(advised.policy.parameters(), plain.policy.parameters(), strict=True):
        assert th.equal(ours, theirs)


@pytest.mark.parametrize("correction", [True, False])
def test_the_step_is_the_gradient_of_eq_3_1(correction):
    kwargs = {"mixing": Mixing(correction=correction), "optimizer_class": th.optim.SGD, "net_arch": [8]}
    env = Advised(Identity(), SOME_ADVICE)
    model = make(env, AdvisedMlp, learning_rate=1.0, gamma=0.9, policy_kwargs=kwargs, **EQ_2_1)
    before = copy.deepcopy(model.policy)
    model.learn(1)  # one episode, one step: what a weight loses is its gradient
    for name, parameter in list(before.named_parameters()):
        if "value" not in name:
            step = parameter - dict(model.policy.named_parameters())[name]
            index = tuple(np.unravel_index(int(step.abs().argmax()), step.shape))
            finite = finite_difference(before, name, index, model.rollout_buffer, correction)
            assert step[index].item() == pytest.approx(finite, rel=1e-3, abs=1e-4)


def finite_difference(policy: Any, name: str, index: tuple[int, ...], buffer: Any, correction: bool) -> float:
    """The slope of eq. 3.1 in one weight, in double precision."""
    sums = []
    for shift in (1e-6, -1e-6):
        moved = copy.deepcopy(policy).double()
        with th.no_grad():
            dict(moved.named_parameters())[name][index] += shift
        sums.append(eq_3_1(moved, buffer, correction))
    return (sums[0] - sums[1]) / 2e-6


def eq_3_1(policy: Any, buffer: Any, correction: bool) -> float:
    """-sum_t R_t log(pi_L pi_A / (pi_L . pi_A)), or without the correction -sum_t R_t log pi_L."""
    total = 0.0
    states, advice = buffer.observations["_observation"].flatten(), buffer.observations["advice"].reshape(-1, 3)
    for state, says, action, later in zip(
        states, advice, buffer.actions.flatten(), buffer.advantages.flatten(), strict=True
    ):
        one_hot = th.nn.functional.one_hot(th.tensor([int(state)]), 3).double()
        own = policy.action_net(policy.mlp_extractor.forward_actor(one_hot)).softmax(-1)[0].detach().numpy()
        mixed = own * says / (own * says).sum() if correction else own
        total -= later * np.log(mixed[int(action)])
    return total


@pytest.mark.parametrize("advice", [[1, 0, 0], [1e-30, 1, 1e-30]])
def test_extreme_advice_leaves_the_weights_finite(advice):
    model = make(Advised(Identity(), np.array(advice, np.float32)), AdvisedMlp).learn(60)
    assert all(parameter.isfinite().all() for parameter in model.policy.parameters())


# --- the bridge ---
def test_an_execution_records_its_decisions_and_replays_them():
    tape, game = Tape(), Advised(Identity(), SOME_ADVICE)
    env = ShepherdEnv(game.observation_space, game.action_space, tape)
    learner, policy = on_policy.learner_classes(PolicyGradient, AdvisedMlp)
    model = learner(policy, env, seed=1, device="cpu")
    actor = on_policy.make_actor(model)
    on_policy.attach(model, tape)
    decisions = play_episode(actor, game, Segment(tape, stream=False, piece=1000))
    tape.put([decisions[0]])  # the next episode begins: only then does the environment reset
    played = []
    with pytest.raises(TapeClosed):
        model.learn(1000, callback=lambda inner, _: watch(tape, played, inner), log_interval=None)
    assert isinstance(actor, SmallActor)
    assert played == [int(decision.action) for decision in decisions]
    assert model._n_updates == 1


def play_episode(actor: Any, game: gym.Env, segment: Segment) -> list[Any]:
    """One episode of ten steps, onto the tape."""
    obs, _ = game.reset(seed=1)
    decisions = [actor.decide(obs, None, None)[0]]
    segment.begin(decisions[0])
    while True:
        obs, reward, _, truncated, _ = game.step(decisions[-1].action)
        if truncated:
            segment.end(float(reward), obs, False, True)
            return decisions
        decisions.append(actor.decide(obs, None, None)[0])
        segment.follow(float(reward), obs, decisions[-1])


def watch(tape: Tape, played: list[int], inner: dict[str, Any]) -> bool:
    """Note the action; after the last item the learner finds the tape closed."""
    played.append(int(inner["actions"][0]))
    if not tape.backlog:
        tape.close()
    return True
