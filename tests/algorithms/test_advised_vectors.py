"""Vectors of numbers are drawn from the mixture of policy and advice that the methods say."""

from __future__ import annotations

import numpy as np
import pytest
import torch as th
from stable_baselines3.common.distributions import kl_divergence

from agents_app.algorithms.advice import Gaussian
from agents_app.algorithms.small_actor import draw_vector
from tests.algorithms.pairs import CORRECTION, METHODS, OWN_MEAN, OWN_STD, SAID, Pair, fixed_gaussian, same
from tests.algorithms.specs import CONTINUOUS


class TestContinuousMethods:
    PRODUCT_VARIANCE = 1 / (1 / OWN_STD**2 + 1 / th.tensor(SAID[2:]) ** 2)
    PRODUCT_MEAN = PRODUCT_VARIANCE * (OWN_MEAN / OWN_STD**2 + th.tensor(SAID[:2] / SAID[2:] ** 2))

    def test_by_sampling_actions_are_drawn_from_the_product(self) -> None:
        policy, batch = fixed_gaussian(continuous_advice="sampling", advice_samples=256)
        th.manual_seed(1)
        with th.no_grad():
            actions, _, log_prob = policy(batch)
        assert th.allclose(actions.mean(0), self.PRODUCT_MEAN, atol=0.03)
        assert th.allclose(actions.std(0), self.PRODUCT_VARIANCE.sqrt(), atol=0.03)
        expected = th.distributions.Normal(self.PRODUCT_MEAN, self.PRODUCT_VARIANCE.sqrt()).log_prob(actions).sum(-1)
        assert th.allclose(log_prob, expected, atol=1e-4)

    def test_few_samples_are_as_much_the_advisors_as_they_can(self) -> None:
        policy, batch = fixed_gaussian(continuous_advice="sampling", advice_samples=1)
        th.manual_seed(1)
        with th.no_grad():
            actions = policy(batch)[0]
        assert th.allclose(actions.mean(0), th.tensor(SAID[:2]), atol=0.03)
        assert th.allclose(actions.std(0), th.tensor(SAID[2:]), atol=0.03)

    @pytest.mark.parametrize(("last_word", "mean"), [("learner", [0.5, -0.5]), ("advisor", [90.0, -90.0])])
    def test_who_has_the_last_word_decides_an_empty_intersection(self, last_word: str, mean: list[float]) -> None:
        policy, batch = fixed_gaussian(continuous_advice="sampling", last_word=last_word)
        batch["advice"][:] = th.tensor([90.0, -90.0, 0.1, 0.1])
        with th.no_grad():
            actions, _, log_prob = policy(batch)
        assert th.allclose(actions.mean(0), th.tensor(mean), atol=0.1)
        assert same(log_prob, policy.evaluate_actions(batch, actions)[1])

    def test_by_reuse_actions_are_the_advisors_so_often(self) -> None:
        policy, batch = fixed_gaussian(advice_method="reuse", psi=0.3)
        batch["advice"][:] = th.tensor([50.0, 50.0, 0.6, 0.9])
        th.manual_seed(1)
        with th.no_grad():
            actions, _, log_prob = policy(batch)
        advised = (actions > 25).all(-1)
        assert th.equal(advised, (actions > 25).any(-1)), "both dimensions are the same player's"
        assert advised.float().mean().item() == pytest.approx(0.3, abs=0.02)
        assert th.allclose(actions[~advised].mean(0), OWN_MEAN, atol=0.05)
        own = th.distributions.Normal(OWN_MEAN, OWN_STD).log_prob(actions).sum(-1) + np.log(0.7)
        assert th.allclose(log_prob[~advised], own[~advised], atol=1e-4)

    @pytest.mark.parametrize("name", ["sampling", "reuse"])
    def test_without_the_correction_the_learning_rule_sees_the_learners_own(self, name: str) -> None:
        policy, batch = fixed_gaussian(learning_correction=False, **METHODS[name])
        with th.no_grad():
            actions, _, log_prob = policy(batch)
        own = th.distributions.Normal(OWN_MEAN, OWN_STD)
        assert th.allclose(log_prob, own.log_prob(actions).sum(-1), atol=1e-4)
        _, again, entropy = policy.evaluate_actions(batch, actions)
        assert th.allclose(again, log_prob)
        assert th.allclose(entropy, own.entropy().sum())

    @pytest.mark.parametrize("name", ["sampling", "reuse", "intersection"])
    @CORRECTION
    def test_the_small_actor_draws_the_same(self, name: str, correction: bool) -> None:
        """The same distribution from NumPy's generator, and the densities that the policy has for its draws."""
        policy, batch = fixed_gaussian(learning_correction=correction, **METHODS[name])
        own = Gaussian(OWN_MEAN.numpy(), OWN_STD.numpy())
        np.random.seed(1)
        with th.no_grad():
            expected = policy(batch)[0]
            drawn, logs = zip(*(draw_vector(own, SAID, policy.mixing) for _ in range(3000)), strict=True)
            actions = th.tensor(np.stack(drawn))
            part = {key: value[:3000] for key, value in batch.items()}
            if correction:
                assert th.allclose(policy.evaluate_actions(part, actions)[1], th.tensor(np.stack(logs)), atol=1e-3)
        assert th.allclose(actions.mean(0), expected.mean(0), atol=0.1)
        assert th.allclose(actions.std(0), expected.std(0), atol=0.1)

    def test_union_is_for_discrete_actions(self) -> None:
        with pytest.raises(ValueError, match="Policy Union is for discrete actions"):
            Pair("vector", CONTINUOUS, {}, True, "PPO", advice_method="union")


class TestMixtureInTRPO:
    def test_its_distance_bounds_the_divergence_of_the_mixtures(self) -> None:
        pair = Pair("vector", CONTINUOUS, {}, True, "TRPO", advice_method="reuse", psi=0.4)
        batch = pair.with_advice(SAID)
        with th.no_grad():
            before = pair.advised.get_distribution(batch)
            pair.advised.action_net.bias += 0.5
            after = pair.advised.get_distribution(batch)
            th.manual_seed(1)
            draws = th.stack([before.sample() for _ in range(4000)])
            logs = [th.stack([one.log_prob(draw) for draw in draws]) for one in (before, after)]
            bound = kl_divergence(before, after).sum(-1)
        measured = (logs[0] - logs[1]).mean(0)
        assert (measured > 0.01).all()
        assert (measured < bound).all()

    def test_of_itself_it_is_none(self) -> None:
        pair = Pair("vector", CONTINUOUS, {}, True, "TRPO", advice_method="reuse")
        one = pair.advised.get_distribution(pair.with_advice(SAID))
        assert kl_divergence(one, one).abs().max() == 0
