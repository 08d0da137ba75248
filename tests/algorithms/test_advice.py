"""The arithmetic of advice: what the formulas say, finite whatever is put in, and nothing at all when neutral."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch as th
from gymnasium import spaces
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from agents_app.algorithms.advice import (
    advice_space,
    advised_space,
    combine,
    intersect_logits,
    intersect_mean,
    neutral_advice,
    with_advice,
    without_advice,
)
from agents_app.algorithms.riders import PLAIN, plain_space

N = 4
sizes = st.integers(1, 8)
SHARES = st.floats(0, 1)


def arrays(n: int, low: float, high: float) -> st.SearchStrategy[np.ndarray]:
    """Vectors of n numbers of float32."""
    return hnp.arrays(np.float32, n, elements=singles(low, high))


def singles(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers of float32."""
    return st.floats(float(np.float32(low)), float(np.float32(high)), width=32, allow_subnormal=False)


@st.composite
def distributions(draw: Any, n: int) -> np.ndarray:
    """Probabilities, among them zeros and certainties."""
    weights = draw(arrays(n, 0, 1)).astype(np.float64)
    weights[draw(st.integers(0, n - 1))] += draw(st.floats(1e-6, 1e6))
    return (weights / weights.sum()).astype(np.float32)


class TestCombine:
    @given(sizes.flatmap(lambda n: st.lists(distributions(n), min_size=1, max_size=5)), SHARES)
    def test_the_result_is_a_distribution_without_zeros(self, given_advice: list[np.ndarray], rho: float) -> None:
        mixed = combine(given_advice, rho)
        assert mixed.dtype == np.float32
        assert (mixed > 0).all()
        assert mixed.sum() == pytest.approx(1.0, abs=1e-5)

    @given(st.lists(distributions(N), min_size=1, max_size=5), SHARES)
    def test_it_is_equation_5_1(self, given_advice: list[np.ndarray], rho: float) -> None:
        summed = sum(pi + 1 - rho for pi in given_advice) / len(given_advice)
        assert combine(given_advice, rho) == pytest.approx(summed / summed.sum(), abs=1e-5)

    def test_full_influence_of_one_advisor_is_its_policy(self) -> None:
        policy = np.array([0.7, 0.2, 0.1], np.float32)
        assert combine([policy], 1.0) == pytest.approx(policy, abs=1e-5)

    def test_less_influence_is_more_entropy(self) -> None:
        policy = np.array([0.7, 0.2, 0.1], np.float32)
        entropies = [-(p * np.log(p)).sum() for p in (combine([policy], rho) for rho in (1.0, 0.7, 0.3, 0.0))]
        assert entropies == sorted(entropies)

    def test_two_that_are_sure_of_different_actions_leave_both_open(self) -> None:
        sure = np.eye(3, dtype=np.float32)
        assert combine([sure[0], sure[2]], 1.0) == pytest.approx([0.5, 0.0, 0.5], abs=1e-5)


class TestIntersection:
    @given(arrays(N, -50, 50), distributions(N))
    def test_it_is_equation_2_6(self, logits: np.ndarray, given_advice: np.ndarray) -> None:
        softened = combine([given_advice], 1.0).astype(np.float64)
        own = np.exp(logits.astype(np.float64) - logits.max())
        expected = own * softened / (own * softened).sum()
        mixed = th.softmax(intersect_logits(th.tensor(logits)[None], th.tensor(softened, dtype=th.float32)[None]), -1)
        assert mixed[0].numpy() == pytest.approx(expected, abs=1e-4)

    @given(sizes.flatmap(lambda n: arrays(n, -1e30, 1e30)))
    def test_neutral_advice_changes_nothing_to_the_bit(self, logits: np.ndarray) -> None:
        neutral = th.tensor(neutral_advice(spaces.Discrete(len(logits))))
        assert th.equal(intersect_logits(th.tensor(logits)[None], neutral[None])[0], th.tensor(logits))

    @given(arrays(N, -80, 80), singles(1e-37, 1e30))
    def test_uniform_advice_of_any_size_changes_nothing(self, logits: np.ndarray, size: float) -> None:
        uniform = th.full((1, N), size)
        assert th.equal(intersect_logits(th.tensor(logits)[None], uniform)[0], th.tensor(logits))

    @given(st.lists(distributions(N), min_size=1, max_size=3), SHARES, arrays(N, -1e4, 1e4))
    def test_extreme_probabilities_stay_finite(
        self, given_advice: list[np.ndarray], rho: float, logits: np.ndarray
    ) -> None:
        own = th.tensor(logits, requires_grad=True)
        mixed = intersect_logits(own[None], th.tensor(combine(given_advice, rho))[None])
        distribution = th.distributions.Categorical(logits=mixed)
        loss = distribution.log_prob(th.tensor([0])).sum() + distribution.entropy().sum()
        loss.backward()
        assert own.grad is not None
        assert th.isfinite(mixed).all()
        assert th.isfinite(loss)
        assert th.isfinite(own.grad).all()

    def test_the_learner_can_push_back_against_an_order(self) -> None:
        order = th.tensor(combine([np.array([1, 0, 0], np.float32)], 1.0))
        logits = th.tensor([[0.0, 0.0, 30.0]])
        assert th.softmax(intersect_logits(logits, order[None]), -1)[0].argmax() == 2

    def test_the_gradient_agrees_with_finite_differences(self) -> None:
        advice = th.tensor([[0.6, 0.3, 0.1], [0.05, 0.9, 0.05]], dtype=th.float64)
        action = th.tensor([2, 0])

        def log_prob(logits: th.Tensor) -> th.Tensor:
            return th.log_softmax(intersect_logits(logits, advice), -1).gather(1, action[:, None])

        logits = th.tensor([[0.3, -0.2, 0.9], [1.0, 2.0, -1.0]], dtype=th.float64, requires_grad=True)
        assert th.autograd.gradcheck(log_prob, logits)


class TestContinuous:
    @given(arrays(3, -1e4, 1e4), arrays(3, -1e4, 1e4), arrays(3, 1e-3, 1e3))
    def test_the_mean_is_half_way(self, own: np.ndarray, advised: np.ndarray, deviation: np.ndarray) -> None:
        advice = th.tensor(np.concatenate([advised, deviation]))
        mixed = intersect_mean(th.tensor(own)[None], advice[None])
        assert mixed[0].numpy() == pytest.approx((own + advised) / 2, rel=1e-5, abs=1e-5)

    @given(sizes.flatmap(lambda n: arrays(n, -1e30, 1e30)))
    def test_neutral_advice_changes_nothing_to_the_bit(self, mean: np.ndarray) -> None:
        neutral = th.tensor(neutral_advice(spaces.Box(-1, 1, (len(mean),), np.float32)))
        assert th.equal(intersect_mean(th.tensor(mean)[None], neutral[None])[0], th.tensor(mean))

    def test_each_dimension_may_be_left_to_the_learner(self) -> None:
        advice = th.tensor([[4.0, 0.0, 1.0, np.inf]])
        assert th.equal(intersect_mean(th.tensor([[2.0, 2.0]]), advice), th.tensor([[3.0, 2.0]]))

    def test_neutral_advice_leaves_a_clean_gradient(self) -> None:
        mean = th.tensor([[1.0, 2.0]], requires_grad=True)
        neutral = th.tensor(neutral_advice(spaces.Box(-1, 1, (2,), np.float32)))[None]
        intersect_mean(mean, neutral).sum().backward()
        assert mean.grad is not None
        assert th.equal(mean.grad, th.ones(1, 2))

    def test_the_gradient_agrees_with_finite_differences(self) -> None:
        advice = th.tensor([[0.4, -1.0, 0.5, np.inf]], dtype=th.float64)
        action = th.tensor([[0.1, 0.2]], dtype=th.float64)

        def log_prob(mean: th.Tensor) -> th.Tensor:
            return th.distributions.Normal(intersect_mean(mean, advice), 0.7).log_prob(action).sum()

        mean = th.tensor([[0.3, -0.2]], dtype=th.float64, requires_grad=True)
        assert th.autograd.gradcheck(log_prob, mean)


OBSERVATIONS: list[Any] = [
    (spaces.Discrete(5), np.int64(3)),
    (spaces.Box(-1, 1, (3,), np.float32), np.zeros(3, np.float32)),
    (spaces.Dict({"a": spaces.Discrete(2), "b": spaces.Box(-1, 1, (2,))}), {"a": np.int64(1), "b": np.zeros(2)}),
]


class TestObservations:
    @pytest.mark.parametrize(("space", "obs"), OBSERVATIONS)
    @pytest.mark.parametrize("actions", [spaces.Discrete(3), spaces.Box(-1, 1, (2,), np.float32)])
    def test_advice_rides_beside_the_observation_and_leaves_no_trace(
        self, space: spaces.Space, obs: Any, actions: spaces.Space
    ) -> None:
        advised = advised_space(space, actions)
        assert advised["advice"] == advice_space(actions)
        seen = with_advice(obs, neutral_advice(actions))
        assert set(seen) == set(advised.spaces)
        rest = without_advice(seen)
        assert rest is obs or rest == obs
        assert plain_space(advised) == space

    def test_without_advice_there_is_nothing_to_leave_aside(self) -> None:
        for space, obs in OBSERVATIONS:
            assert without_advice(obs) is obs
            assert plain_space(space) is space

    def test_the_key_is_one_that_no_client_may_use(self) -> None:
        assert PLAIN not in ("advice", "")
        assert PLAIN.startswith("_")


@settings(max_examples=20)
@given(sizes)
def test_neutral_advice_lies_in_its_space(n: int) -> None:
    assert advice_space(spaces.Discrete(n)).contains(neutral_advice(spaces.Discrete(n)))
    box = spaces.Box(-1, 1, (n, 2), np.float32)
    assert neutral_advice(box).shape == advice_space(box).shape == (4 * n,)
