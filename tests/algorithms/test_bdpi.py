"""BDPI: the batched ensemble is the loop, it learns, and it takes advice as eq. 3.4 and eq. 6.1 say."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from gymnasium import spaces

from agents_app.algorithms import off_policy
from agents_app.algorithms.advice import neutral_advice
from agents_app.algorithms.bdpi import BDPI, Batches
from agents_app.algorithms.bdpi_policies import BDPIPolicy
from agents_app.algorithms.ensemble import Ensemble, StackedAdam
from agents_app.algorithms.mixing import Mixing
from agents_app.algorithms.replay import Segment, Tape, TapeClosed
from envs_app.shepherd_env import ShepherdEnv
from tests.algorithms.bdpi_loop import LoopBDPI, networks_of
from tests.algorithms.games import Advised, Grid, Identity, mean_return

QUICK: dict[str, Any] = {
    "n_critics": 4,
    "q_loops": 2,
    "fit_steps": 4,
    "batch_size": 64,
    "learning_starts": 64,
    "learning_rate": 5e-3,
    "train_freq": 2,
}
METHODS = ["intersection", "geometric", "union", "reuse"]


def make(env: gym.Env, **options: Any) -> BDPI:
    """A small BDPI; `method`, `psi` and `correction` are the policy's."""
    mixing = Mixing(**{name: options.pop(name) for name in ("method", "psi", "correction") if name in options})
    given: dict[str, Any] = {"policy_kwargs": {"net_arch": [32], "mixing": mixing}, "seed": 1, "device": "cpu"}
    name = "MultiInputPolicy" if isinstance(env.observation_space, spaces.Dict) else "MlpPolicy"
    return BDPI(name, env, **QUICK | given | options)


def make_batches(inputs: int, actions: int, critics: int, size: int, advised: bool = False) -> Batches:
    """Random transitions, in double precision; `advised`: with random advice, of which every second is neutral."""
    shape, double = (critics, size), th.float64
    discounts = 0.99 * (th.rand(*shape, 1, dtype=double) > 0.1)
    return Batches(
        th.randn(*shape, inputs, dtype=double),
        th.randint(actions, (*shape, 1)),
        th.randn(*shape, 1, dtype=double),
        th.randn(*shape, inputs, dtype=double),
        discounts,
        some_advice(critics, size, actions) if advised else None,
    )


def some_advice(critics: int, size: int, actions: int) -> th.Tensor:
    """Distributions, (N, B, A); every second is 1 for each action, as of nobody."""
    advice = (3 * th.randn(critics, size, actions, dtype=th.float64)).softmax(-1)
    advice[:, ::2] = 1.0
    return advice


# --- the ensemble ---
@pytest.mark.parametrize("method", ["", "intersection", "reuse"])
@pytest.mark.parametrize("q_loops", [1, 4])
def test_the_batched_ensemble_gives_the_same_numbers_as_a_loop(q_loops, method):
    model = make(gym.make("CartPole-v1"), n_critics=3, q_loops=q_loops, method=method or "intersection", psi=0.3)
    model.policy.double()
    loop = LoopBDPI(model)
    for _ in range(3):
        batches = make_batches(inputs=4, actions=2, critics=3, size=16, advised=bool(method))
        model.train_epoch(batches)
        loop.train(batches)
    probe = th.randn(3, 50, 4, dtype=th.float64)
    for ours, theirs in zip(model.policy.critics, zip(*loop.critics, strict=True), strict=True):
        expected = th.stack([network(x) for network, x in zip(theirs, probe, strict=True)])
        th.testing.assert_close(ours(probe), expected, rtol=1e-9, atol=1e-9)
    th.testing.assert_close(model.actor(probe[:1])[0], loop.actor(probe[0]), rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("softmax", [False, True])
@pytest.mark.parametrize("sizes", [(5, 3), (3, 8, 2), (4, 8, 3, 6)])
def test_its_gradients_are_those_of_autograd(sizes, softmax):
    ensemble = Ensemble(2, sizes, softmax=softmax).double()
    x, target = th.randn(2, 7, sizes[0], dtype=th.float64), th.rand(2, 7, sizes[-1], dtype=th.float64)
    gradients = ensemble.gradients(x, target)
    for member, network in enumerate(networks_of(ensemble)):
        output = network(x[member])
        th.testing.assert_close(ensemble(x)[member], output)
        th.nn.functional.mse_loss(output.softmax(-1) if softmax else output, target[member]).backward()
        linear = [module for module in network if isinstance(module, th.nn.Linear)]
        for gradient, layer in zip(gradients, linear, strict=True):
            expected = th.cat([layer.weight.grad.T, layer.bias.grad[None]])
            th.testing.assert_close(gradient[member], expected)


def test_looking_up_a_number_is_the_same_as_its_one_hot_vector_without_a_bias():
    lookup, dense = Ensemble(2, (6, 4, 3), lookup=True), Ensemble(2, (6, 4, 3))
    assert not lookup.layers[0][:, -1].any()
    dense.load_state_dict(lookup.state_dict())
    numbers, target = th.randint(6, (2, 9)), th.randn(2, 9, 3)
    one_hot = th.nn.functional.one_hot(numbers, 6).float()
    th.testing.assert_close(lookup(numbers), dense(one_hot))
    ours, theirs = lookup.gradients(numbers, target), dense.gradients(one_hot, target)
    theirs[0][:, -1] = 0.0
    for gradient, expected in zip(ours, theirs, strict=True):
        th.testing.assert_close(gradient, expected)


def test_a_few_members_at_a_time_learn_as_all_at_once(monkeypatch):
    few, many = (Ensemble(5, (3, 8, 2)) for _ in range(2))
    many.load_state_dict(few.state_dict())
    for ensemble, cache in ((few, 1), (many, 10**9)):
        monkeypatch.setattr("agents_app.algorithms.ensemble.CACHE", cache)
        ensemble.optimizer = StackedAdam(ensemble.parameters(), lr=0.01)
        for seed in range(3):
            th.manual_seed(seed)
            ensemble.fit(th.randn(5, 9, 3), th.randn(5, 9, 2), 4)
    for ours, theirs in zip(few.parameters(), many.parameters(), strict=True):
        th.testing.assert_close(ours, theirs)


def test_its_members_begin_different():
    first, second = networks_of(Ensemble(2, (3, 4, 2)))
    assert not th.equal(first(th.ones(3)), second(th.ones(3)))


# --- learning ---
def test_it_learns_the_identity_game():
    model = make(Identity(), gamma=0.5).learn(300)
    assert mean_return(model, Identity()) >= 9.5  # of 10


@pytest.mark.parametrize("q_loops", [1, 3])
def test_with_an_odd_number_of_iterations_both_networks_of_a_critic_learn_alike(q_loops):
    model = make(Identity(), q_loops=q_loops)
    begun = [critics.layers[-1].detach().clone() for critics in model.policy.critics]
    model.learn(300)
    first, second = (
        float((critics.layers[-1].detach() - before).abs().mean())
        for critics, before in zip(model.policy.critics, begun, strict=True)
    )
    assert first / second == pytest.approx(1.0, abs=0.5)


def test_states_are_counted_from_0():
    with pytest.raises(ValueError, match="from 0"):
        BDPIPolicy(gym.spaces.Discrete(5, start=1), gym.spaces.Discrete(2), lambda _: 1e-3)


def test_it_learns_the_best_way_through_a_grid():
    model = make(Grid()).learn(800)
    assert mean_return(model, Grid(), 1) == 14  # the best return there is


def test_it_learns_from_every_kind_of_observation():
    vector, image = spaces.Box(-1, 1, (3,)), spaces.Box(0, 255, (4, 4, 1), np.uint8)
    for space in (vector, image, spaces.MultiDiscrete([2, 3])):
        assert (
            make(gym.wrappers.TransformObservation(Identity(), lambda _, s=space: s.sample(), space))
            .learn(70)
            ._n_updates
        )
    parts = spaces.Dict({"b": vector, "a": spaces.Discrete(3), "image": image})
    env = gym.wrappers.TransformObservation(Identity(), lambda _: parts.sample(), parts)
    assert make(env).learn(70)._n_updates


def test_it_comes_back_from_a_file_as_it_was(tmp_path: Path):
    model = make(Identity()).learn(80)
    model.save(tmp_path / "model.zip")
    loaded = BDPI.load(tmp_path / "model.zip", env=Identity(), device="cpu")
    states = np.arange(3)
    assert (
        loaded.predict(states, deterministic=True)[0].tolist() == model.predict(states, deterministic=True)[0].tolist()
    )
    assert (loaded.alpha, loaded.n_critics, loaded.policy.net_arch) == (model.alpha, 4, [32])
    for ours, theirs in zip(loaded.policy.optimizers(), model.policy.optimizers(), strict=True):
        assert str(ours.state_dict()) == str(theirs.state_dict())
    loaded.learn(70, reset_num_timesteps=False)


def test_the_policy_alone_comes_back_from_a_file(tmp_path: Path):
    policy = make(Identity(), method="reuse").policy
    policy.save(str(tmp_path / "policy.pt"))
    loaded = type(policy).load(str(tmp_path / "policy.pt"), device="cpu")
    assert loaded.mixing.method == "reuse"
    assert all(th.equal(a, b) for a, b in zip(loaded.parameters(), policy.parameters(), strict=True))


def test_what_was_not_seen_for_long_is_forgotten_and_not_kept_as_a_denormal_number():
    model = make(Identity(400)).learn(70)
    means = [state["exp_avg"] for adam in model.policy.optimizers() for state in adam.state.values()]
    for mean in means:
        mean.fill_(2e-38)
    for _ in range(20):
        model.train(1, 64)
    bits = np.concatenate([mean.numpy().ravel() for mean in means]).view(np.int32) & 0x7FFFFFFF
    assert not ((bits > 0) & (bits < 0x00800000)).any()


# --- advice ---
@pytest.mark.parametrize("method", METHODS)
def test_neutral_advice_changes_nothing_to_the_bit(method):
    plain, advised = make(Identity()).learn(100), make(Advised(Identity()), method=method, psi=0.3).learn(100)
    for ours, theirs in zip(advised.policy.parameters(), plain.policy.parameters(), strict=True):
        assert th.equal(ours, theirs)


def test_advice_that_is_a_reward_changes_no_action_and_no_target():
    bad = np.array([0.8, 0.1, 0.1], np.float32)
    plain, advised = make(Identity()).learn(80), make(Advised(Identity(), bad), method="shaping").learn(80)
    for ours, theirs in zip(advised.policy.parameters(), plain.policy.parameters(), strict=True):
        assert th.equal(ours, theirs)


def test_reuse_acts_on_the_mixture_of_eq_2_5():
    policy = make(Advised(Identity()), method="reuse", psi=0.25).policy
    logits, advice = th.tensor([[0.6, 0.3, 0.1]]).log(), th.tensor([[0.0, 0.0, 1.0]])
    th.testing.assert_close(policy.mix(logits, advice).softmax(-1), th.tensor([[0.45, 0.225, 0.325]]))


@pytest.mark.parametrize("method", ["intersection", "reuse"])
def test_an_order_is_obeyed(method):
    env = Advised(Identity(), np.array([0, 1, 0], np.float32))
    model = make(env, method=method, psi=1.0).learn(64)
    assert model.replay_buffer is not None
    assert (model.replay_buffer.actions[:64] == 1).all()


@pytest.mark.parametrize("advice", [[1, 0, 0], [1e-30, 1, 1e-30], [0.999999, 5e-7, 5e-7]])
@pytest.mark.parametrize("method", METHODS)
def test_extreme_advice_leaves_the_weights_finite(method, advice):
    model = make(Advised(Identity(), np.array(advice, np.float32)), method=method, psi=1.0).learn(120)
    assert model._n_updates and all(parameter.isfinite().all() for parameter in model.policy.parameters())


def test_it_learns_in_spite_of_bad_advice_with_the_correction():
    bad = Advised(Identity(), np.array([0.8, 0.1, 0.1], np.float32))
    assert mean_return(make(bad, gamma=0.5).learn(300), Identity()) >= 9


def test_the_correction_can_be_left_out():
    bad = np.array([0.8, 0.1, 0.1], np.float32)
    with_it, without = (make(Advised(Identity(), bad), correction=on).learn(80) for on in (True, False))
    assert not th.equal(with_it.actor.layers[0], without.actor.layers[0])


# --- the bridge ---
def test_an_execution_records_its_decisions_and_replays_them():
    tape, game = Tape(), Advised(Identity())
    env = ShepherdEnv(game.observation_space, game.action_space, tape)
    learner, policy = off_policy.learner_classes(BDPI, BDPI.policy_aliases["MlpPolicy"])
    model = learner(policy, env, **QUICK | {"seed": 1, "device": "cpu"})
    actor = off_policy.make_actor(model)
    off_policy.attach(model, tape)
    segment, obs, actions, reward = Segment(tape, stream=False, piece=1000), game.reset(seed=1)[0], [], 0.0
    for step in range(80):
        decision, _ = actor.decide(obs, None, None)
        actions.append(int(decision.action))
        segment.follow(reward, obs, decision) if step % 10 else segment.begin(decision)
        obs, reward, _, truncated, _ = game.step(decision.action)
        if truncated:
            segment.end(reward, obs, False, True)
            obs = game.reset()[0]
    with pytest.raises(TapeClosed):
        _learn_all(model, tape)
    assert model.replay_buffer.actions[:79, 0, 0].tolist() == actions[:79]
    assert model._n_updates > 0
    assert th.equal(actor.algorithm.policy.actor.layers[0], model.actor.layers[0])
    assert actor.exploit({"_observation": 1, "advice": neutral_advice(env.action_space)}, None, None)[0] in range(3)


def _learn_all(model: BDPI, tape: Tape) -> None:
    take = tape._take

    def take_or_close() -> Any:
        if not tape.backlog:
            tape.close()
        return take()

    tape._take = take_or_close  # type: ignore[method-assign]
    model.learn(1000, log_interval=None)  # type: ignore[arg-type]
