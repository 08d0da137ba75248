"""An advised policy is the stock policy with the same weights, but for the advice; and neutral advice is no advice."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th

from agents_app.algorithms.advice import combine, neutral_advice, with_advice
from agents_app.algorithms.policies import policy_name
from agents_app.algorithms.registry import get_row
from agents_app.algorithms.spec import AgentSpec
from tests.algorithms.building import built, some, stack
from tests.algorithms.specs import CONTINUOUS, DISCRETE, OBSERVATIONS, make_spec

KINDS = pytest.mark.parametrize("kind", OBSERVATIONS)
ACTIONS = pytest.mark.parametrize(
    ("actions", "parameters"),
    [(DISCRETE, {}), (CONTINUOUS, {}), (CONTINUOUS, {"use_sde": True})],
    ids=["discrete", "continuous", "gSDE"],
)
CORRECTION = pytest.mark.parametrize("correction", [True, False], ids=["correction", "no correction"])


class Pair:
    """An advised policy, the stock one with the same weights, and observations for both."""

    def __init__(self, kind: str, actions: Any, parameters: dict[str, Any], correction: bool, algorithm: str) -> None:
        facts: dict[str, Any] = {"advice_method": "intersection", "learning_correction": correction}
        self.spec: AgentSpec = make_spec(algorithm, actions, OBSERVATIONS[kind], parameters, **facts)
        self.advised = built(self.spec).policy
        plain = make_spec(algorithm, actions, OBSERVATIONS[kind], parameters)
        self.stock = self._stock_policy(algorithm, plain)
        self.stock.load_state_dict(self.advised.state_dict())
        self.observations = some(plain.observations())
        self.batch = stack(self.observations)
        self.actions = th.tensor(np.stack(some(plain.actions())))

    @staticmethod
    def _stock_policy(algorithm: str, spec: AgentSpec) -> Any:
        row = get_row(algorithm)
        stock, name = row.load(), policy_name(row, spec.observations())
        env: gym.Env = gym.Env()
        env.observation_space, env.action_space = spec.observations(), spec.actions()
        use_sde = bool(spec.parameters.get("use_sde"))
        return stock(name, env, policy_kwargs={"net_arch": [8]}, use_sde=use_sde, n_steps=64, device="cpu").policy

    def with_advice(self, advice: np.ndarray) -> Any:
        """The batch with the same advice everywhere."""
        return stack([with_advice(obs, advice) for obs in self.observations])

    def neutral(self) -> Any:
        """The batch with neutral advice."""
        return self.with_advice(neutral_advice(self.spec.actions()))


def same(one: Any, other: Any) -> bool:
    """Whether two tensors are equal to the bit."""
    return th.equal(one, other)


@KINDS
@ACTIONS
@CORRECTION
@pytest.mark.parametrize("algorithm", ["PPO", "A2C"])
class TestNeutral:
    def test_nothing_differs_from_the_stock_policy(
        self, algorithm: str, correction: bool, actions: Any, parameters: dict[str, Any], kind: str
    ) -> None:
        pair = Pair(kind, actions, parameters, correction, algorithm)
        results = []
        for policy, batch in ((pair.advised, pair.neutral()), (pair.stock, pair.batch)):
            th.manual_seed(3)
            if parameters:
                policy.reset_noise(4)
            results.append(
                [
                    *policy(batch),
                    *policy.evaluate_actions(batch, pair.actions),
                    policy.predict_values(batch),
                    policy.get_distribution(batch).log_prob(pair.actions),
                    policy.get_distribution(batch).mode(),
                ]
            )
        assert all(same(one, other) for one, other in zip(*results, strict=True))

    def test_nor_do_the_gradients(
        self, algorithm: str, correction: bool, actions: Any, parameters: dict[str, Any], kind: str
    ) -> None:
        pair = Pair(kind, actions, parameters, correction, algorithm)
        for policy, batch in ((pair.advised, pair.neutral()), (pair.stock, pair.batch)):
            values, log_prob, entropy = policy.evaluate_actions(batch, pair.actions)
            (values.sum() + log_prob.sum() + entropy.sum()).backward()
        pairs = zip(pair.advised.parameters(), pair.stock.parameters(), strict=True)
        assert all((one.grad is None) == (other.grad is None) for one, other in pairs)
        pairs = zip(pair.advised.parameters(), pair.stock.parameters(), strict=True)
        assert all(one.grad is None or same(one.grad, other.grad) for one, other in pairs)


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
