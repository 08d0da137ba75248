"""Every way of mixing two policies: neutral advice is none, results are distributions, an order is obeyed, torch is NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch as th
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st

from agents_app.algorithms.advice import (
    FLOOR,
    Gaussian,
    acceptance,
    as_order,
    combine,
    combine_logs,
    geometric_logits,
    intersect_logits,
    intersect_mean,
    is_empty,
    is_neutral,
    log_density,
    mix_logits,
    neutral_advice,
    product,
    reuse_log_density,
    reuse_logits,
    says_nothing,
    shaping_reward,
)
from agents_app.algorithms.mixing import ADVISOR, GEOMETRIC, LEARNER, REUSE, SHAPING, UNION, Mixing
from tests.algorithms.test_advice import SHARES, arrays, distributions, sizes

N = 4
METHODS = [
    Mixing(),
    Mixing(last_word=ADVISOR),
    Mixing(GEOMETRIC),
    Mixing(GEOMETRIC, weight=0.2),
    Mixing(GEOMETRIC, weight=50.0),
    Mixing(GEOMETRIC, weight=0.0),
    Mixing(UNION),
    Mixing(REUSE, psi=0.3),
    Mixing(REUSE, psi=1.0),
    Mixing(REUSE, psi=0.0),
    Mixing(SHAPING),
]
EVERY = pytest.mark.parametrize(
    "mixing", METHODS, ids=lambda mixing: f"{mixing.method} {mixing.psi} {mixing.weight} {mixing.last_word}"
)
BOX = spaces.Box(-1, 1, (3,), np.float32)


def softmax(logits: Any) -> np.ndarray:
    """Probabilities, in double precision."""
    numbers = np.asarray(logits, np.float64)
    shares = np.exp(numbers - numbers.max(-1, keepdims=True))
    return shares / shares.sum(-1, keepdims=True)


def gaussians(n: int) -> st.SearchStrategy[Gaussian]:
    """Policies over n numbers."""
    return st.builds(Gaussian, arrays(n, -100, 100), arrays(n, 1e-3, 100))


def advice_of(n: int, silent: bool = True) -> st.SearchStrategy[np.ndarray]:
    """Means and deviations, from none to infinite."""
    deviations = st.one_of(arrays(n, 0, 1e3), st.sampled_from([np.zeros(n, np.float32), np.full(n, 1e30, np.float32)]))

    def build(mean: np.ndarray, deviation: np.ndarray, mute: list[bool]) -> np.ndarray:
        return np.concatenate([mean, np.where(mute if silent else False, np.inf, deviation)]).astype(np.float32)

    return st.builds(build, arrays(n, -1e3, 1e3), deviations, st.lists(st.booleans(), min_size=n, max_size=n))


def tensors(policy: Gaussian) -> Gaussian:
    """The same policy for torch."""
    return Gaussian(th.tensor(policy.mean), th.tensor(policy.deviation))


def density(actions: np.ndarray, mean: float, deviation: float) -> np.ndarray:
    """Of a Gaussian of one dimension."""
    return np.exp(-0.5 * ((actions - mean) / deviation) ** 2) / (deviation * np.sqrt(2 * np.pi))


@EVERY
class TestDiscrete:
    @given(logits=sizes.flatmap(lambda n: arrays(n, -1e30, 1e30)))
    def test_neutral_advice_changes_nothing_to_the_bit(self, mixing: Mixing, logits: np.ndarray) -> None:
        neutral = neutral_advice(spaces.Discrete(len(logits)))
        assert np.array_equal(mix_logits(logits, neutral, mixing), logits)
        batch = th.tensor(np.stack([logits, logits]), requires_grad=True)
        mixed = mix_logits(batch, th.tensor(neutral), mixing)
        assert th.equal(mixed, batch)
        mixed.sum().backward()
        assert th.equal(batch.grad, th.ones_like(batch))

    @given(logits=arrays(N, -1e4, 1e4), given_advice=distributions(N))
    def test_the_result_is_a_finite_distribution(
        self, mixing: Mixing, logits: np.ndarray, given_advice: np.ndarray
    ) -> None:
        mixed = mix_logits(logits, given_advice, mixing)
        assert mixed.dtype == np.float32
        assert np.isfinite(mixed).all()
        assert softmax(mixed).sum() == pytest.approx(1.0)

    @given(
        rows=st.lists(st.tuples(arrays(N, -300, 300), distributions(N), st.booleans()), min_size=1, max_size=5),
    )
    def test_batches_agree_with_single_states_and_torch_with_numpy(
        self, mixing: Mixing, rows: list[tuple[np.ndarray, np.ndarray, bool]]
    ) -> None:
        logits = np.stack([row[0] for row in rows])
        given_advice = np.stack([np.ones(N, np.float32) if neutral else advice for _, advice, neutral in rows])
        batch = softmax(mix_logits(th.tensor(logits), th.tensor(given_advice), mixing))
        for row, own, advice in zip(batch, logits, given_advice, strict=True):
            assert softmax(mix_logits(own, advice, mixing)) == pytest.approx(row, abs=1e-4)

    @given(logits=arrays(N, -1e4, 1e4), given_advice=distributions(N))
    def test_losses_and_gradients_stay_finite(
        self, mixing: Mixing, logits: np.ndarray, given_advice: np.ndarray
    ) -> None:
        own = th.tensor(logits, requires_grad=True)
        mixed = th.distributions.Categorical(logits=mix_logits(own[None], th.tensor(given_advice)[None], mixing))
        before = th.distributions.Categorical(logits=mixed.logits.detach())
        loss = mixed.log_prob(th.tensor([0])) + mixed.entropy() + th.distributions.kl_divergence(mixed, before)
        loss.sum().backward()
        assert th.isfinite(loss).all()
        assert th.isfinite(own.grad).all()

    def test_the_gradient_agrees_with_finite_differences(self, mixing: Mixing) -> None:
        """Of eq. 3.1: -sum_t R_t log pi(a_t|s_t), with pi the mixed policy."""
        advice = th.tensor([[0.6, 0.3, 0.1], [0.05, 0.9, 0.05], [1.0, 1.0, 1.0], [0.0, 1.0, 0.0]], dtype=th.float64)
        actions, returns = th.tensor([2, 0, 1, 1]), th.tensor([3.0, -1.0, 2.0, 0.5], dtype=th.float64)

        def loss(logits: th.Tensor) -> th.Tensor:
            log_prob = mix_logits(logits, advice, mixing).log_softmax(-1).gather(1, actions[:, None])[:, 0]
            return -(returns * log_prob).sum()

        logits = th.tensor([[0.3, -0.2, 0.9], [1.0, 2.0, -1.0], [0.0, 0.5, 1.0], [1.0, 0.0, 2.0]], dtype=th.float64)
        assert th.autograd.gradcheck(loss, logits.requires_grad_())


class TestIntersection:
    @given(arrays(N, -30, 30), st.integers(0, N - 1))
    def test_an_order_is_obeyed(self, logits: np.ndarray, action: int) -> None:
        order = np.eye(N, dtype=np.float32)[action]
        for last_word in (LEARNER, ADVISOR):
            assert softmax(intersect_logits(logits, order, last_word)) == pytest.approx(order, abs=1e-30)

    @given(st.integers(0, N - 1), st.integers(1, N - 1))
    def test_the_empty_intersection_is_decided_by_who_has_the_last_word(self, action: int, step: int) -> None:
        order, sure = np.eye(N, dtype=np.float32)[[action, (action + step) % N]]
        for impossible in (-200.0, -1e30, -np.inf):
            logits = np.where(sure == 1, 0.0, impossible).astype(np.float32)
            assert np.array_equal(intersect_logits(logits, order, LEARNER), logits)
            assert softmax(intersect_logits(logits, order, ADVISOR)) == pytest.approx(order)

    def test_advice_with_the_floor_is_no_order(self) -> None:
        softened = combine([np.array([1, 0, 0], np.float32)], 1.0)
        assert intersect_logits(np.array([0, 0, 30], np.float32), softened).argmax() == 2


class TestGeometricMean:
    @given(arrays(N, -50, 50), st.lists(distributions(N), min_size=1, max_size=4), st.floats(0, 5))
    def test_it_is_the_weighted_mean_of_the_logarithms_of_all(
        self, logits: np.ndarray, advisors: list[np.ndarray], weight: float
    ) -> None:
        product = np.log(softmax(logits))
        for advisor in advisors:
            product = product + weight * np.log(advisor.astype(np.float64) + FLOOR)
        expected = softmax(product / (1 + weight * len(advisors)))
        assert softmax(geometric_logits(logits, combine_logs(advisors, 1.0), weight)) == pytest.approx(
            expected, abs=1e-4
        )

    @given(st.lists(distributions(N), min_size=1, max_size=6), SHARES)
    def test_combined_advice_sums_to_the_number_of_advisors_in_whichever_order(
        self, advisors: list[np.ndarray], rho: float
    ) -> None:
        combined = combine_logs(advisors, rho)
        assert combined.dtype == np.float32
        assert (combined > 0).all()
        assert combined.sum() == pytest.approx(len(advisors), rel=1e-5)
        assert combine_logs(advisors[::-1], rho) == pytest.approx(combined, rel=1e-3)

    @given(distributions(N), st.floats(0, 5), st.integers(1, 4))
    def test_it_is_no_surer_than_those_who_agree(self, policy: np.ndarray, weight: float, count: int) -> None:
        said = ((policy + 1e-4) / (policy + 1e-4).sum()).astype(np.float32)
        mixed = geometric_logits(np.log(said), combine_logs([said] * count, 1.0), weight)
        assert softmax(mixed) == pytest.approx(said, abs=1e-3)
        assert softmax(intersect_logits(np.log(said), said)).max() >= said.max() - 1e-6

    @given(arrays(N, -30, 30), st.integers(0, N - 1))
    def test_an_order_is_obeyed(self, logits: np.ndarray, action: int) -> None:
        order = np.eye(N, dtype=np.float32)[action]
        assert softmax(geometric_logits(logits, order, 1.0)) == pytest.approx(order, abs=1e-20)

    @given(gaussians(2), arrays(2, -100, 100), SHARES)
    def test_of_gaussians_of_one_deviation_it_is_the_gaussian_between(
        self, own: Gaussian, told: np.ndarray, part: float
    ) -> None:
        between = Gaussian(intersect_mean(own.mean, np.concatenate([told, own.deviation]), part), own.deviation)
        actions = own.mean + own.deviation * np.array([[0.0], [1.0]])
        mixed = (1 - part) * log_density(actions, own) + part * log_density(actions, Gaussian(told, own.deviation))
        differences = np.diff(mixed)[0], np.diff(log_density(actions, between))[0]
        assert differences[0] == pytest.approx(differences[1], rel=1e-2, abs=1e-2)


class TestReuse:
    @given(arrays(N, -50, 50), distributions(N), SHARES)
    def test_it_is_equation_2_5(self, logits: np.ndarray, given_advice: np.ndarray, psi: float) -> None:
        expected = psi * given_advice + (1 - psi) * softmax(logits)
        assert softmax(reuse_logits(logits, given_advice, psi)) == pytest.approx(expected, abs=1e-5)

    @given(arrays(N, -50, 50), distributions(N))
    def test_union_is_equation_3_2(self, logits: np.ndarray, given_advice: np.ndarray) -> None:
        summed = softmax(logits) + given_advice
        mixed = softmax(mix_logits(logits, given_advice, Mixing(UNION)))
        assert mixed == pytest.approx(summed / summed.sum(), abs=1e-5)

    def test_uniform_probabilities_are_advice_and_ones_are_none(self) -> None:
        logits, uniform = np.array([0, 1, 5], np.float32), np.full(3, 1 / 3, np.float32)
        assert not is_neutral(uniform)
        assert softmax(reuse_logits(logits, uniform, 1.0)) == pytest.approx(uniform)
        assert np.array_equal(reuse_logits(logits, np.ones(3, np.float32), 1.0), logits)


class TestProduct:
    @given(gaussians(3))
    def test_neutral_advice_changes_nothing_to_the_bit(self, own: Gaussian) -> None:
        for neutral in (neutral_advice(BOX), np.array([5, 5, 5, np.inf, np.inf, np.inf], np.float32)):
            assert says_nothing(neutral)
            for last_word in (LEARNER, ADVISOR):
                assert all(map(np.array_equal, product(own, neutral, last_word), own))
            action = own.mean + 1
            assert np.array_equal(reuse_log_density(action, own, neutral, 0.7), log_density(action, own))
            assert shaping_reward(neutral, action) == 0.0

    def test_it_is_the_normalised_product_of_both_densities(self) -> None:
        own = Gaussian(np.array([1.0]), np.array([0.7]))
        actions = np.linspace(-10, 10, 20_001)
        both = density(actions, 1.0, 0.7) * density(actions, -0.5, 1.5)
        agreed = product(own, np.array([-0.5, 1.5]))
        assert density(actions, *(part.item() for part in agreed)) == pytest.approx(
            both / (both.sum() * 0.001), abs=1e-6
        )

    def test_algorithm_1_tends_to_it(self) -> None:
        own, advice = Gaussian(np.array([1.0]), np.array([0.7])), np.array([-0.5, 1.5])
        candidates = -0.5 + 1.5 * np.random.default_rng(1).standard_normal((200_000, 1))
        weights = softmax(acceptance(candidates, own, advice))
        mean = (weights * candidates[:, 0]).sum()
        deviation = np.sqrt((weights * (candidates[:, 0] - mean) ** 2).sum())
        assert (mean, deviation) == pytest.approx(tuple(part.item() for part in product(own, advice)), abs=0.01)

    @given(gaussians(3), advice_of(3))
    def test_everything_stays_finite(self, own: Gaussian, advice: np.ndarray) -> None:
        policy = Gaussian(*(th.tensor(part, requires_grad=True) for part in own))
        for last_word in (LEARNER, ADVISOR):
            mixed = product(policy, th.tensor(advice), last_word)
            action = mixed.mean.detach() + mixed.deviation.detach()
            loss = log_density(action, mixed) + reuse_log_density(action, policy, th.tensor(advice), 0.3)
            gradients = th.autograd.grad(loss, [*policy])
            assert all(th.isfinite(part).all() for part in (*mixed, loss, *gradients))
            assert (mixed.deviation > 0).all()
        assert np.isfinite(shaping_reward(advice, own.mean))

    @given(st.lists(st.tuples(gaussians(3), advice_of(3)), min_size=1, max_size=4))
    def test_batches_agree_with_single_states_and_torch_with_numpy(self, rows: list[tuple[Any, Any]]) -> None:
        own = Gaussian(*(np.stack([getattr(row[0], name) for row in rows]) for name in ("mean", "deviation")))
        advice = np.stack([row[1] for row in rows])
        batch = product(tensors(own), th.tensor(advice))
        reused = reuse_log_density(batch.mean, tensors(own), th.tensor(advice), 0.3)
        for index, (single, said) in enumerate(rows):
            for ours, theirs in zip(product(single, said), batch, strict=True):
                assert ours == pytest.approx(theirs[index].numpy(), rel=1e-3, abs=1e-4)
            log = reuse_log_density(batch.mean[index].numpy(), single, said, 0.3)
            assert log == pytest.approx(float(reused[index]), rel=1e-2, abs=1e-2)

    def test_an_order_leaves_the_learner_nothing_but_the_order(self) -> None:
        own = Gaussian(np.zeros(2, np.float32), np.ones(2, np.float32))
        order = as_order(np.array([0.5, -0.3, 0.4, np.inf], np.float32), spaces.Box(-1, 1, (2,), np.float32))
        agreed = product(own, order)
        assert agreed.mean == pytest.approx([0.5, 0.0], abs=1e-4)
        assert agreed.deviation == pytest.approx([0.002, 1.0], abs=1e-4)

    def test_the_empty_intersection_is_decided_by_who_has_the_last_word(self) -> None:
        own = Gaussian(np.zeros(2, np.float32), np.full(2, 0.1, np.float32))
        advice = np.array([50, 50, 0.1, 0.1], np.float32)
        assert is_empty(own, advice)
        assert all(map(np.array_equal, product(own, advice, LEARNER), own))
        agreed = product(own, advice, ADVISOR)
        assert np.array_equal(np.concatenate(agreed), advice)

    def test_each_dimension_may_be_left_to_the_learner(self) -> None:
        own = Gaussian(np.array([1.0, 1.0]), np.array([1.0, 1.0]))
        agreed = product(own, np.array([3.0, 9.0, 1.0, np.inf]))
        assert agreed.mean == pytest.approx([2.0, 1.0])
        candidates = np.array([[1.0, 0.0], [1.0, 9.0]])
        assert acceptance(candidates, own, np.array([3.0, 9.0, 1.0, np.inf])) == pytest.approx([0.0, 0.0])

    def test_the_gradient_agrees_with_finite_differences(self) -> None:
        advice = th.tensor([[0.4, -1.0, 0.5, np.inf], [30.0, 30.0, 0.5, 0.1]], dtype=th.float64)
        actions = th.tensor([[0.1, 0.2], [0.5, -0.5]], dtype=th.float64)

        def losses(mean: th.Tensor, log_std: th.Tensor) -> tuple[th.Tensor, th.Tensor]:
            own = Gaussian(mean, log_std.exp() * th.ones_like(mean))
            return log_density(actions, product(own, advice)), reuse_log_density(actions, own, advice, 0.3)

        mean = th.tensor([[0.3, -0.2], [0.1, 0.4]], dtype=th.float64, requires_grad=True)
        log_std = th.tensor([-0.3, 0.2], dtype=th.float64, requires_grad=True)
        assert th.autograd.gradcheck(losses, (mean, log_std))


class TestReuseOfGaussians:
    def test_it_is_equation_2_5(self) -> None:
        own, actions = Gaussian(np.array([1.0]), np.array([0.7])), np.linspace(-4, 4, 9)[:, None]
        expected = 0.3 * density(actions, -0.5, 1.5) + 0.7 * density(actions, 1.0, 0.7)
        mixed = np.exp(reuse_log_density(actions, own, np.array([-0.5, 1.5]), 0.3))
        assert mixed == pytest.approx(expected[:, 0])


class TestShaping:
    @given(distributions(N), st.integers(0, N - 1))
    def test_the_reward_is_the_advisors_probability(self, advice: np.ndarray, action: int) -> None:
        assert shaping_reward(advice, np.int64(action)) == pytest.approx(advice[action], abs=1e-6)

    def test_or_its_density(self) -> None:
        advice = np.array([0.5, 9.0, 2.0, np.inf], np.float32)
        assert shaping_reward(advice, np.array([1.0, 7.0], np.float32)) == pytest.approx(density(1.0, 0.5, 2.0))

    def test_silence_is_no_reward(self) -> None:
        assert shaping_reward(np.ones(3, np.float32), 1) == 0.0

    def test_a_certain_advisor_gives_no_infinite_reward(self) -> None:
        assert shaping_reward(np.array([0.0] * 60 + [0.0] * 60, np.float32), np.zeros(60)) == pytest.approx(1e6)


class TestOrders:
    @given(distributions(N))
    def test_an_order_is_the_most_probable_action(self, advice: np.ndarray) -> None:
        order, best = as_order(advice, spaces.Discrete(N)), advice == advice.max()
        assert np.array_equal(order > 0, best)
        assert order.sum() == pytest.approx(4 if best.all() else 1)
        assert order[best] == pytest.approx(order.max())

    @given(advice_of(3))
    def test_or_the_mean(self, advice: np.ndarray) -> None:
        order = as_order(advice, BOX)
        assert np.array_equal(order[:3], advice[:3])
        assert np.array_equal(np.isinf(order[3:]), np.isinf(advice[3:]))
        assert (order[3:][~np.isinf(order[3:])] == np.float32(0.002)).all()
