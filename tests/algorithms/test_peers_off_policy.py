"""What algorithms off the policy advise: what they would do without advice, in units of actions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from sb3_contrib import TQC
from stable_baselines3 import SAC
from stable_baselines3.common.noise import OrnsteinUhlenbeckActionNoise

from agents_app.algorithms.advice import neutral_advice
from agents_app.algorithms.explorers import noise_deviation
from tests.algorithms.off_policy import NOISY, VALUES, draws, here, place, set_actor, set_values


class TestPeers:
    """What they advise: what they would do without advice, in units of actions."""

    @pytest.mark.parametrize("stock", [SAC, TQC])
    @pytest.mark.parametrize("mean", [0.0, 0.5, 3.0])
    @pytest.mark.parametrize("deviation", [0.05, 0.5, 1.5])
    def test_squashed_ones_tell_their_greedy_action_and_how_far_they_stray(
        self, stock: Any, mean: float, deviation: float
    ) -> None:
        model = here(stock)
        set_actor(model, [mean, -mean], deviation)
        said = model.policy.get_distribution(place()).distribution
        greedy = model.predict(place().numpy(), deterministic=True)[0][0]
        assert said.mean[0].detach().numpy() == pytest.approx(greedy, abs=1e-4)
        strays = np.sqrt(((draws(model, neutral_advice(model.action_space), 20_000) - greedy) ** 2).mean(0))
        assert said.stddev[0].detach().numpy() == pytest.approx(strays, rel=0.06)

    @pytest.mark.parametrize("stock", NOISY)
    def test_deterministic_ones_tell_their_action_and_their_noise(self, stock: Any) -> None:
        model = here(stock, noise=0.2)
        said = model.policy.get_distribution(place()).distribution
        assert said.mean[0].detach().numpy() == pytest.approx(model.predict(place().numpy())[0][0], abs=1e-5)
        assert said.stddev[0].detach().numpy() == pytest.approx([0.8, 1.0])

    @pytest.mark.parametrize("stock", NOISY)
    def test_without_noise_they_are_sure(self, stock: Any) -> None:
        said = here(stock, noise=0.0).policy.get_distribution(place()).distribution
        assert (said.stddev < 1e-5).all()

    def test_the_deviation_of_correlated_noise_is_what_it_comes_to(self) -> None:
        noise = OrnsteinUhlenbeckActionNoise(np.zeros(1), np.full(1, 0.3), theta=2.0)
        np.random.seed(1)
        values = np.array([noise() for _ in range(60_000)])[1000:]
        expected = noise_deviation(noise, spaces.Box(-1, 1, (1,)))
        assert values.std() == pytest.approx(expected.item(), rel=0.06)

    @pytest.mark.parametrize("stock", VALUES)
    def test_one_that_explores_still_says_so(self, stock: Any) -> None:
        model = here(stock)
        set_values(model, 1)
        for rate in (1.0, 0.5, 0.0):
            model.exploration_rate = rate
            said = model.policy.get_distribution(place()).distribution.probs[0].numpy()
            assert said == pytest.approx(rate / 4 + (1 - rate) * np.eye(4)[1])
