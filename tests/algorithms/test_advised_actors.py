"""Actors off the policy draw their vectors of numbers with advice."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sb3_contrib import TQC
from stable_baselines3 import SAC

from agents_app.algorithms.advice import Gaussian, product
from agents_app.algorithms.mixing import ADVISOR, BY_SAMPLING, REUSE, UNION, Mixing
from tests.algorithms.off_policy import ACTORS, METHODS, NOISY, draws, here, set_actor


class TestNumbers:
    """All in units of the plane: its middle is (0, 5), and half of its width (4, 5)."""

    ADVICE = [2.0, 7.5, 0.8, 1.0]  # in SB3's units, means of 0.5 and deviations of 0.2

    @pytest.mark.parametrize("stock", [SAC, TQC])
    def test_by_the_mean_squashed_policies_meet_half_way_and_keep_their_own_noise(self, stock: Any) -> None:
        model = here(stock)
        set_actor(model, [0.4, -0.2], 0.3)
        scaled = (draws(model, self.ADVICE) - [0, 5]) / [4, 5]
        half_way = (np.tanh([0.4, -0.2]) + 0.5) / 2
        assert np.arctanh(scaled).mean(0) == pytest.approx(np.arctanh(half_way), abs=0.02)
        assert np.arctanh(scaled).std(0) == pytest.approx([0.3, 0.3], rel=0.05)

    @pytest.mark.parametrize("stock", NOISY)
    @pytest.mark.parametrize("noise", [0.0, 0.1])
    def test_by_the_mean_deterministic_ones_meet_half_way_and_keep_their_noise(self, stock: Any, noise: float) -> None:
        model = here(stock, noise=noise)
        set_actor(model, [0.4, -0.2])
        scaled = (draws(model, self.ADVICE) - [0, 5]) / [4, 5]
        assert scaled.mean(0) == pytest.approx((np.tanh([0.4, -0.2]) + 0.5) / 2, abs=0.01)
        assert scaled.std(0) == pytest.approx([noise, noise], rel=0.05, abs=1e-6)

    @pytest.mark.parametrize("stock", NOISY)
    def test_by_sampling_deterministic_ones_tend_to_the_product_of_both_densities(self, stock: Any) -> None:
        model = here(stock, Mixing(continuous=BY_SAMPLING, samples=300), noise=0.2)
        set_actor(model, [0.4, 0.2])
        scaled = (draws(model, self.ADVICE) - [0, 5]) / [4, 5]
        own = Gaussian(np.tanh([0.4, 0.2]), np.full(2, 0.2))
        expected = product(own, np.array([0.5, 0.5, 0.2, 0.2]))
        assert scaled.mean(0) == pytest.approx(expected.mean, abs=0.02)
        assert scaled.std(0) == pytest.approx(expected.deviation, rel=0.1)

    @pytest.mark.parametrize("stock", [SAC, TQC])
    def test_by_sampling_squashed_ones_do_too(self, stock: Any) -> None:
        model = here(stock, Mixing(continuous=BY_SAMPLING, samples=300))
        set_actor(model, [0.4, -0.2], 0.4)
        scaled = (draws(model, self.ADVICE) - [0, 5]) / [4, 5]
        grid = np.linspace(-0.999, 0.999, 4001)
        for index, mean in enumerate([0.4, -0.2]):
            own = np.exp(-0.5 * ((np.arctanh(grid) - mean) / 0.4) ** 2) / (1 - grid**2)
            density = own * np.exp(-0.5 * ((grid - 0.5) / 0.2) ** 2)
            expected = (grid * density).sum() / density.sum()
            spread = np.sqrt(((grid - expected) ** 2 * density).sum() / density.sum())
            assert scaled[:, index].mean() == pytest.approx(expected, abs=0.02)
            assert scaled[:, index].std() == pytest.approx(spread, rel=0.1)

    @pytest.mark.parametrize("stock", ACTORS)
    def test_reuse_takes_the_advisors_action_so_often(self, stock: Any) -> None:
        model = here(stock, Mixing(REUSE, psi=0.3), noise=0.05)
        set_actor(model, [-1.5, -1.5], 0.05)
        heeded = draws(model, [3.0, 8.0, 0.01, 0.01])[:, 0] > 2.5
        assert heeded.mean() == pytest.approx(0.3, abs=0.03)

    @pytest.mark.parametrize("stock", ACTORS)
    @pytest.mark.parametrize("method", ["intersection", "sampling", "geometric", "reuse"])
    def test_the_warm_up_is_a_policy_too_whose_mean_is_the_middle(self, stock: Any, method: str) -> None:
        model = here(stock, METHODS[method])
        model.num_timesteps = 0
        model.action_noise = None
        scaled = (draws(model, self.ADVICE) - [0, 5]) / [4, 5]
        expected = {"intersection": (0.23, 0.55), "geometric": (0.36, 0.52), "sampling": (0.5, 0.2)}
        mean, deviation = (expected | {"reuse": (0.45, 0.31)})[method]
        assert scaled.mean(0) == pytest.approx([mean, mean], abs=0.03)
        assert scaled.std(0) == pytest.approx([deviation, deviation], abs=0.04)

    @pytest.mark.parametrize("stock", ACTORS)
    def test_an_order_is_obeyed_by_sampling(self, stock: Any) -> None:
        model = here(stock, Mixing(continuous=BY_SAMPLING))
        assert draws(model, [1.0, 2.0, 0.0, 0.0], 10) == pytest.approx(np.tile([1.0, 2.0], (10, 1)), abs=1e-5)

    @pytest.mark.parametrize("stock", ACTORS)
    def test_where_nothing_is_possible_to_both_the_last_word_counts(self, stock: Any) -> None:
        for last_word, sign in (("learner", -1), (ADVISOR, 1)):
            model = here(stock, Mixing(continuous=BY_SAMPLING, last_word=last_word), noise=0.01)
            set_actor(model, [-1.0, -1.0], 0.01)
            scaled = (draws(model, [3.0, 9.0, 0.01, 0.01], 10) - [0, 5]) / [4, 5]
            assert (np.sign(scaled) == sign).all()

    @pytest.mark.parametrize("stock", ACTORS)
    def test_greedy_actions_heed_no_advice(self, stock: Any) -> None:
        model = here(stock)
        obs = {"_observation": np.zeros(3, np.float32), "advice": np.array([4, 4, 0.1, 0.1], np.float32)}
        expected, _ = model.predict(obs["_observation"], deterministic=True)
        assert np.array_equal(model.predict(obs, deterministic=True)[0], expected)

    @pytest.mark.parametrize("stock", NOISY)
    def test_sampling_needs_a_density(self, stock: Any) -> None:
        with pytest.raises(ValueError, match="action_noise"):
            here(stock, Mixing(continuous=BY_SAMPLING), noise=0.0)

    @pytest.mark.parametrize("stock", ACTORS)
    def test_union_is_for_choices(self, stock: Any) -> None:
        with pytest.raises(ValueError, match="Union"):
            here(stock, Mixing(UNION))
