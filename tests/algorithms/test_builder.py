"""Every algorithm of the registry is built for every kind of observation, and its actor records what can be replayed."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import torch as th
from gymnasium import spaces
from stable_baselines3.common.noise import NormalActionNoise, OrnsteinUhlenbeckActionNoise

from agents_app.algorithms.actor import Actor
from agents_app.algorithms.advice import neutral_advice, with_advice
from agents_app.algorithms.builder import ENDLESS, family_of
from agents_app.algorithms.registry import ROWS, get_row
from agents_app.algorithms.spec import see
from agents_app.algorithms.weights import assign, flatten
from agents_app.spaces import parse_space
from tests.algorithms.building import built, some
from tests.algorithms.specs import CONTINUOUS, DISCRETE, IMAGE, OBSERVATIONS, actions_of, every_kind, make_spec

NAMES = [row.name for row in ROWS]
REPLAYING = [row.name for row in ROWS if row.family != "direct"]


def first_actions(name: str) -> Any:
    """A kind of actions that the algorithm can choose."""
    return actions_of(get_row(name))[0]


def actor_of(algorithm: Any, spec: Any) -> Actor:
    """As an execution makes it."""
    return family_of(spec).make_actor(algorithm)


class TestEvery:
    @pytest.mark.parametrize(("name", "actions", "kind"), list(every_kind()))
    def test_it_is_built_and_acts(self, name: str, actions: Any, kind: str) -> None:
        spec = make_spec(name, actions, OBSERVATIONS[kind])
        actor = actor_of(built(spec), spec)
        for obs in some(spec.observations()):
            action, _ = actor.exploit(obs, None, None)
            assert spec.actions().contains(spec.actions().dtype.type(action))  # type: ignore[union-attr]

    @pytest.mark.parametrize("name", REPLAYING)
    def test_its_actor_explores_within_the_space(self, name: str) -> None:
        for actions in actions_of(get_row(name)):
            spec = make_spec(name, actions)
            actor, memory = actor_of(built(spec), spec), None
            for obs in some(spec.observations(), 40):
                decision, memory = actor.decide(obs, memory, None)
                assert spec.actions().contains(np.asarray(decision.action))
                assert decision.obs is obs

    @pytest.mark.parametrize("name", NAMES)
    def test_its_actor_has_a_policy_of_its_own(self, name: str) -> None:
        spec = make_spec(name, first_actions(name))
        algorithm = built(spec)
        actor = actor_of(algorithm, spec)
        own = getattr(actor, "algorithm", actor).policy
        assert own is not algorithm.policy
        assert not own.training
        assert np.array_equal(flatten(own), flatten(algorithm.policy))

    @pytest.mark.parametrize("name", NAMES)
    def test_what_it_learns_reaches_the_actor(self, name: str) -> None:
        spec = make_spec(name, first_actions(name))
        algorithm = built(spec)
        actor = actor_of(algorithm, spec)
        with th.no_grad():
            for parameter in algorithm.policy.parameters():
                parameter.fill_(0.25)
        own = getattr(actor, "algorithm", actor).policy
        shared = family_of(spec).SHARES_WEIGHTS
        assert np.array_equal(flatten(own), flatten(algorithm.policy)) == shared
        actor.update(flatten(algorithm.policy))
        assert np.array_equal(flatten(own), flatten(algorithm.policy))

    @pytest.mark.parametrize("name", NAMES)
    def test_the_lead_of_its_actor_is_bounded(self, name: str) -> None:
        spec = make_spec(name, first_actions(name))
        lead = family_of(spec).allowed_lead(built(spec))
        assert 0 <= lead <= 64
        assert (lead == 0) == (get_row(name).family == "direct")


class TestRecords:
    """What the actor recorded is what the algorithm would compute at the same place."""

    @pytest.mark.parametrize("actions", [DISCRETE, CONTINUOUS], ids=["discrete", "continuous"])
    @pytest.mark.parametrize("kind", OBSERVATIONS)
    @pytest.mark.parametrize("name", ["PPO", "A2C", "TRPO", "PolicyGradient"])
    def test_on_the_policy_the_value_and_the_log_probability(self, name: str, kind: str, actions: Any) -> None:
        spec = make_spec(name, actions, OBSERVATIONS[kind])
        algorithm = built(spec)
        actor = actor_of(algorithm, spec)
        for obs in some(spec.observations(), 10):
            decision, _ = actor.decide(obs, None, None)
            action, value, log_prob = decision.replay
            tensors, _ = algorithm.policy.obs_to_tensor(obs)
            values, log_probs, _ = algorithm.policy.evaluate_actions(tensors, action)
            assert value.shape == (1, 1) or value.shape == (1,)
            assert th.allclose(value.reshape(-1), values.reshape(-1), atol=1e-5)
            assert th.allclose(log_prob, log_probs, atol=1e-5)
            expected = action.numpy()[0]
            if isinstance(spec.actions(), spaces.Box):
                expected = np.clip(expected, -2, 2)
            assert np.array_equal(decision.action, expected)

    @pytest.mark.parametrize("correction", [True, False])
    @pytest.mark.parametrize("actions", [DISCRETE, CONTINUOUS], ids=["discrete", "continuous"])
    @pytest.mark.parametrize("kind", OBSERVATIONS)
    def test_with_advice_too(self, kind: str, actions: Any, correction: bool) -> None:
        facts: dict[str, Any] = {"advice_method": "intersection", "learning_correction": correction}
        spec = make_spec("PPO", actions, OBSERVATIONS[kind], **facts)
        algorithm = built(spec)
        actor = actor_of(algorithm, spec)
        advice = np.array([0.7, 0.2, 0.1] if actions == DISCRETE else [1.0, -1.0, 0.5, 0.5], np.float32)
        for given in (advice, neutral_advice(spec.actions())):
            for obs in some(spec.observations(), 5):
                decision, _ = actor.decide(with_advice(obs, given), None, None)
                action, value, log_prob = decision.replay
                tensors, _ = algorithm.policy.obs_to_tensor(obs)
                tensors = with_advice(tensors, th.tensor(given)[None])  # type: ignore[arg-type]
                values, log_probs, _ = algorithm.policy.evaluate_actions(tensors, action)
                assert th.allclose(value.reshape(-1), values.reshape(-1), atol=1e-5)
                assert th.allclose(log_prob, log_probs, atol=1e-4)

    def test_masked_actions_are_never_chosen(self) -> None:
        spec = make_spec("MaskablePPO")
        actor = actor_of(built(spec), spec)
        mask = np.array([False, True, False])
        for obs in some(spec.observations(), 20):
            decision, _ = actor.decide(obs, None, mask)
            assert decision.action == 1
            assert decision.mask is mask
            assert actor.exploit(obs, None, mask)[0] == 1
        free, _ = actor.decide(obs, None, None)
        assert free.mask is None  # all are allowed, which ShepherdEnv tells the algorithm

    def test_a_recurrent_policy_remembers_its_episode(self) -> None:
        spec = make_spec("RecurrentPPO")
        actor = actor_of(built(spec), spec)
        obs = some(spec.observations(), 1)[0]
        first, memory = actor.decide(obs, None, None)
        again, _ = actor.decide(obs, None, None)
        later, _ = actor.decide(obs, memory, None)
        assert th.equal(first.replay[1], again.replay[1])
        assert not th.equal(first.replay[1], later.replay[1])

    @pytest.mark.parametrize("name", ["SAC", "TD3", "DDPG", "TQC", "CrossQ"])
    def test_off_the_policy_the_buffer_gets_the_action_in_its_own_scale(self, name: str) -> None:
        spec = make_spec(name, [[2], -2, 2], parameters={"learning_starts": 0, "action_noise": ""})
        algorithm = built(spec)
        decision, _ = actor_of(algorithm, spec).decide(some(spec.observations(), 1)[0], None, None)
        action, buffered = decision.replay
        assert np.array_equal(decision.action, action[0])
        assert action[0] == pytest.approx(2 * buffered[0], abs=1e-5)

    def test_exploration_is_annealed_by_the_actor_itself(self) -> None:
        spec = make_spec("DQN", parameters={"total_timesteps": 100, "exploration_fraction": 0.5, "learning_starts": 0})
        actor: Any = actor_of(built(spec), spec)
        for obs in some(spec.observations(), 60):
            actor.decide(obs, None, None)
        assert actor.algorithm.exploration_rate == pytest.approx(0.05)

    def test_each_session_has_a_noise_of_its_own_that_begins_anew_with_an_episode(self) -> None:
        spec = make_spec("TD3", CONTINUOUS, parameters={"learning_starts": 0, "action_noise": "ou 0.3"})
        actor: Any = actor_of(built(spec), spec)
        obs, long = some(spec.observations(), 1)[0], None
        greedy = actor.exploit(obs, None, None)[0]
        noises = []
        for _ in range(200):
            decision, long = actor.decide(obs, long, None)
            noises.append(decision.replay[1][0] - actor.algorithm.policy.scale_action(greedy[None])[0])
            _, memory = actor.decide(obs, None, None)  # another session's first step
            assert memory is not long
        moved = np.abs(np.diff(noises, axis=0)).mean()
        assert np.std(noises) > 2 * moved, "it is correlated in time"
        assert actor.exploit(obs, long, None)[1] is long


class TestExplorationMatrix:
    """gSDE: one matrix of noise is kept for some steps, so that actions are smooth."""

    @pytest.mark.parametrize(("name", "every"), [("PPO", 4), ("RecurrentPPO", 4), ("SAC", 2), ("TQC", -1), ("A2C", -1)])
    def test_it_is_drawn_anew_when_sb3_would(self, name: str, every: int) -> None:
        spec = make_spec(name, CONTINUOUS, parameters={"use_sde": True, "sde_sample_freq": every})
        algorithm = built(spec)
        actor: Any = actor_of(algorithm, spec)
        own = getattr(actor, "algorithm", actor)
        exploring = getattr(own, "actor", own.policy)
        obs, matrices = some(spec.observations(), 1)[0], []
        for _ in range(8):
            actor.decide(obs, None, None)
            matrices.append(exploring.action_dist.exploration_mat.clone())
        changes = [not th.equal(one, other) for one, other in pairwise(matrices)]
        expected = every if every > 0 else (4 if name == "TQC" else 1000)  # train_freq is 4; A2C's rollout is longer
        assert changes == [step % expected == 0 for step in range(1, 8)]


class TestParameters:
    def test_layers_are_read(self) -> None:
        policy = built(make_spec(parameters={"net_arch": "12, 7"})).policy
        assert [layer.out_features for layer in policy.mlp_extractor.policy_net if hasattr(layer, "out_features")] == [
            12, 7
        ]  # fmt: skip

    @pytest.mark.parametrize("name", NAMES)
    def test_the_learning_rate_falls_over_the_horizon_and_stays_there(self, name: str) -> None:
        falling = {"learning_rate": 0.01, "learning_rate_end": 0.002, "total_timesteps": 100}
        algorithm = built(make_spec(name, first_actions(name), parameters=falling))
        for steps, rate in ((0, 0.01), (50, 0.006), (100, 0.002), (1000, 0.002)):
            algorithm._update_current_progress_remaining(steps, ENDLESS)
            assert algorithm.lr_schedule(algorithm._current_progress_remaining) == pytest.approx(rate)

    def test_it_falls_from_the_default(self) -> None:
        schedule = built(make_spec("BDPI", parameters={"learning_rate_end": 0.0})).lr_schedule
        assert (schedule(1.0), schedule(0.0)) == (1e-4, 0.0)

    def test_noise_is_read(self) -> None:
        for text, kind in (("normal 0.3", NormalActionNoise), ("ou 0.3", OrnsteinUhlenbeckActionNoise)):
            assert isinstance(built(make_spec("TD3", CONTINUOUS, parameters={"action_noise": text})).action_noise, kind)
        assert built(make_spec("TD3", CONTINUOUS, parameters={"action_noise": " "})).action_noise is None
        with pytest.raises(ValueError, match="action_noise is"):
            built(make_spec("TD3", CONTINUOUS, parameters={"action_noise": "loud 0.1"}))

    def test_numbers_among_texts_are_read(self) -> None:
        algorithm = built(make_spec("SAC", CONTINUOUS, parameters={"ent_coef": "0.25", "target_entropy": "-3"}))
        assert algorithm.ent_coef == 0.25
        assert algorithm.target_entropy == -3.0

    def test_unknown_parameters_are_refused(self) -> None:
        with pytest.raises(TypeError, match="gamme"):
            built(make_spec(parameters={"gamme": 0.9}))

    def test_the_seed_decides_the_weights(self) -> None:
        one, same, other = (flatten(built(make_spec(), seed).policy) for seed in (1, 1, 2))
        assert np.array_equal(one, same)
        assert not np.array_equal(one, other)

    def test_schedules_follow_the_horizon_and_stay_at_their_end(self) -> None:
        algorithm = built(make_spec("DQN", parameters={"total_timesteps": 200}))
        for steps, remaining in ((0, 1.0), (50, 0.75), (200, 0.0), (10_000, 0.0)):
            algorithm._update_current_progress_remaining(steps, 2**62)
            assert algorithm._current_progress_remaining == remaining


class TestImages:
    @pytest.mark.parametrize("shape", [[36, 40, 3], [3, 36, 40], [36, 3, 40], [36, 40, 1]])
    def test_channels_come_first_wherever_they_were(self, shape: list[int]) -> None:
        spec = make_spec(observations=[shape, 0, 255])
        space = parse_space([shape, 0, 255])
        seen = see(space, space.sample())
        assert spec.observations().contains(seen)
        assert seen.shape == (min(shape), *(size for size in shape if size != min(shape)))
        decision, _ = actor_of(built(spec), spec).decide(seen, None, None)
        assert decision.action in range(3)

    def test_pixels_keep_their_places(self) -> None:
        space = parse_space([[40, 36, 3], 0, 255])
        obs = space.sample()
        assert see(space, obs)[2, 10, 20] == obs[10, 20, 2]

    def test_an_image_in_a_dictionary_too(self) -> None:
        space = parse_space({"camera": IMAGE, "room": 4})
        obs = space.sample()
        assert see(space, obs)["camera"].shape == (3, 36, 36)
        assert see(space, obs)["room"] == obs["room"]


class TestWeights:
    @pytest.mark.parametrize("name", NAMES)
    def test_they_are_carried_from_one_policy_to_another(self, name: str) -> None:
        spec = make_spec(name, first_actions(name))
        one, other = built(spec, 1).policy, built(spec, 2).policy
        assign(other, flatten(one))
        assert np.array_equal(flatten(one), flatten(other))

    def test_those_of_another_network_are_refused(self) -> None:
        small, large = (built(make_spec(parameters={"net_arch": size})).policy for size in ("8", "9"))
        with pytest.raises(ValueError, match="numbers"):
            assign(large, flatten(small))
