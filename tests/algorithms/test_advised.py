"""An advised policy is the stock policy with the same weights, but for the advice; and neutral advice is no advice."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch as th

from agents_app.algorithms.advice import combine, with_advice
from tests.algorithms.pairs import ACTIONS, CORRECTION, FITTING, KINDS, Pair, same
from tests.algorithms.specs import CONTINUOUS, DISCRETE, OBSERVATIONS


@pytest.mark.parametrize("algorithm", ["PPO", "A2C", "TRPO"])
@pytest.mark.parametrize(("actions", "parameters", "advice"), FITTING, ids=str)
@CORRECTION
class TestNeutral:
    def test_nothing_differs_from_the_stock_policy(
        self, algorithm: str, correction: bool, actions: Any, parameters: dict[str, Any], advice: dict[str, Any]
    ) -> None:
        for kind in OBSERVATIONS:
            pair = Pair(kind, actions, parameters, correction, algorithm, **advice)
            results = [results_of(pair, *one) for one in ((pair.advised, pair.neutral()), (pair.stock, pair.batch))]
            assert all(same(one, other) for one, other in zip(*results, strict=True))

    def test_nor_do_the_gradients(
        self, algorithm: str, correction: bool, actions: Any, parameters: dict[str, Any], advice: dict[str, Any]
    ) -> None:
        pair = Pair("vector", actions, parameters, correction, algorithm, **advice)
        for policy, batch in ((pair.advised, pair.neutral()), (pair.stock, pair.batch)):
            values, log_prob, entropy = policy.evaluate_actions(batch, pair.actions)
            (values.sum() + log_prob.sum() + entropy.sum()).backward()
        pairs = list(zip(pair.advised.parameters(), pair.stock.parameters(), strict=True))
        assert all((one.grad is None) == (other.grad is None) for one, other in pairs)
        assert all(one.grad is None or same(one.grad, other.grad) for one, other in pairs)


def results_of(pair: Pair, policy: Any, batch: Any) -> list[th.Tensor]:
    """All that an algorithm asks of its policy, twice, for the draws."""
    th.manual_seed(3)
    if policy.use_sde:
        policy.reset_noise(4)
    return [
        *policy(batch),
        *policy.evaluate_actions(batch, pair.actions),
        policy.predict_values(batch),
        policy.get_distribution(batch).log_prob(pair.actions),
        policy.get_distribution(batch).mode(),
        *policy(batch),
    ]


class TestAdvice:
    ADVICE = combine([np.array([0.1, 0.1, 0.8], np.float32)], 1.0)

    @KINDS
    def test_actions_are_drawn_from_the_intersection(self, kind: str) -> None:
        pair = Pair(kind, DISCRETE, {}, True, "PPO")
        own = pair.stock.get_distribution(pair.batch).distribution.probs
        mixed = own * th.tensor(self.ADVICE)
        mixed = mixed / mixed.sum(-1, keepdim=True)
        th.manual_seed(1)
        batch = pair.with_advice(self.ADVICE)
        drawn = th.stack([pair.advised(batch)[0] for _ in range(600)])
        shares = th.stack([(drawn == action).float().mean(0) for action in range(3)], -1)
        assert th.allclose(shares, mixed, atol=0.08)

    def test_the_learning_rule_sees_the_mixed_policy_with_the_correction(self) -> None:
        pair = Pair("vector", DISCRETE, {}, True, "PPO")
        own = pair.stock.get_distribution(pair.batch).distribution.probs
        mixed = th.log(own * th.tensor(self.ADVICE) / (own * th.tensor(self.ADVICE)).sum(-1, keepdim=True))
        batch = pair.with_advice(self.ADVICE)
        expected = mixed.gather(1, pair.actions[:, None])[:, 0]
        assert th.allclose(pair.advised.evaluate_actions(batch, pair.actions)[1], expected, atol=1e-5)
        taken, _, log_prob = pair.advised(batch)
        assert th.allclose(log_prob, mixed.gather(1, taken[:, None])[:, 0], atol=1e-5)

    def test_without_the_correction_it_sees_the_learners_own(self) -> None:
        pair = Pair("vector", DISCRETE, {}, False, "PPO")
        batch = pair.with_advice(self.ADVICE)
        expected = pair.stock.evaluate_actions(pair.batch, pair.actions)
        assert all(map(same, pair.advised.evaluate_actions(batch, pair.actions), expected))
        taken, _, log_prob = pair.advised(batch)
        assert same(log_prob, pair.stock.evaluate_actions(pair.batch, taken)[1])

    @CORRECTION
    def test_continuous_actions_are_drawn_half_way_with_the_learners_own_deviation(self, correction: bool) -> None:
        pair = Pair("vector", CONTINUOUS, {}, correction, "PPO")
        batch = pair.with_advice(np.array([4.0, -4.0, 0.1, 0.1], np.float32))
        own = pair.stock.get_distribution(pair.batch).distribution
        th.manual_seed(1)
        drawn = th.stack([pair.advised(batch)[0] for _ in range(800)]).detach()
        assert th.allclose(drawn.mean(0), (own.mean + th.tensor([4.0, -4.0])) / 2, atol=0.2)
        assert th.allclose(drawn.std(0), own.stddev, atol=0.15)
        seen = pair.advised.evaluate_actions(batch, pair.actions)[1]
        middle = (own.mean + th.tensor([4.0, -4.0])) / 2 if correction else own.mean
        expected = th.distributions.Normal(middle, own.stddev).log_prob(pair.actions).sum(-1)
        assert th.allclose(seen, expected, atol=1e-4)

    @KINDS
    @ACTIONS
    def test_values_and_greedy_actions_heed_no_advice(
        self, kind: str, actions: Any, parameters: dict[str, Any]
    ) -> None:
        pair = Pair(kind, actions, parameters, True, "PPO")
        advice = self.ADVICE if actions == DISCRETE else np.array([9.0, -9.0, 1.0, 1.0], np.float32)
        batch = pair.with_advice(advice)
        assert same(pair.advised.predict_values(batch), pair.stock.predict_values(pair.batch))
        assert same(pair.advised(batch)[1], pair.stock.predict_values(pair.batch))
        for obs in pair.observations:
            expected, _ = pair.stock.predict(obs, deterministic=True)
            for given in (obs, with_advice(obs, advice)):
                assert np.array_equal(pair.advised.predict(given, deterministic=True)[0], expected)

    def test_a_certain_advisor_and_a_certain_learner_leave_everything_finite(self) -> None:
        pair = Pair("vector", DISCRETE, {}, True, "PPO")
        with th.no_grad():
            pair.advised.action_net.bias[:] = th.tensor([500.0, 0.0, -500.0])
        batch = pair.with_advice(combine([np.array([0, 0, 1], np.float32)], 1.0))
        values, log_prob, entropy = pair.advised.evaluate_actions(batch, th.tensor([0, 1, 2, 2]))
        (values.sum() + log_prob.sum() + entropy.sum()).backward()
        assert th.isfinite(log_prob).all()
        gradients = [p.grad for p in pair.advised.parameters() if p.grad is not None]
        assert gradients
        assert all(th.isfinite(gradient).all() for gradient in gradients)
