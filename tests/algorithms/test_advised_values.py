"""Algorithms that value choices draw from a mixture of their epsilon-greedy policy and the advice."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from agents_app.algorithms.mixing import SHAPING, Mixing
from tests.algorithms.off_policy import METHODS, VALUES, draws, here, place, set_values, shares


@pytest.mark.parametrize("stock", VALUES)
class TestChoices:
    ADVICE = np.array([0.1, 0.6, 0.2, 0.1])

    def test_the_learners_policy_is_epsilon_greedy(self, stock: Any) -> None:
        model = here(stock)
        set_values(model, 2)
        model.exploration_rate = 0.2
        expected = [0.05, 0.05, 0.85, 0.05]
        assert model.policy.get_distribution(place()).distribution.probs[0].numpy() == pytest.approx(expected)
        assert shares(draws(model, [0.25] * 4)) == pytest.approx(expected, abs=0.03)

    @pytest.mark.parametrize("method", ["intersection", "geometric", "union", "reuse"])
    def test_actions_are_drawn_from_the_mixture(self, stock: Any, method: str) -> None:
        model = here(stock, METHODS[method])
        set_values(model, 2)
        model.exploration_rate = 0.4
        own = np.array([0.1, 0.1, 0.7, 0.1])
        mixed = {
            "intersection": own * self.ADVICE / (own * self.ADVICE).sum(),
            "geometric": own**0.2 * self.ADVICE**0.8 / (own**0.2 * self.ADVICE**0.8).sum(),
            "union": (own + self.ADVICE) / 2,
            "reuse": 0.9 * self.ADVICE + 0.1 * own,
        }[method]
        assert shares(draws(model, self.ADVICE)) == pytest.approx(mixed, abs=0.03)

    def test_in_the_warm_up_it_is_drawn_from_the_advice(self, stock: Any) -> None:
        model = here(stock)
        model.num_timesteps = 0
        assert shares(draws(model, self.ADVICE)) == pytest.approx(self.ADVICE, abs=0.03)

    @pytest.mark.parametrize("steps", [0, 1000], ids=["warm-up", "later"])
    def test_an_order_is_obeyed(self, stock: Any, steps: int) -> None:
        model = here(stock)
        model.num_timesteps, model.exploration_rate = steps, 0.01
        set_values(model, 2)
        assert shares(draws(model, [0, 0, 0, 1])) == pytest.approx([0, 0, 0, 1])

    @pytest.mark.parametrize(("last_word", "chosen"), [("learner", 2), ("advisor", 3)])
    def test_where_nothing_is_possible_to_both_the_last_word_counts(
        self, stock: Any, last_word: str, chosen: int
    ) -> None:
        model = here(stock, Mixing(last_word=last_word))
        model.exploration_rate = 0.0
        set_values(model, 2)
        assert set(draws(model, [0, 0, 0, 1])) == {chosen}

    def test_as_a_reward_it_changes_no_action(self, stock: Any) -> None:
        model = here(stock, Mixing(SHAPING))
        model.exploration_rate = 0.0
        set_values(model, 2)
        assert set(draws(model, [0, 0, 0, 1])) == {2}

    def test_greedy_actions_heed_no_advice(self, stock: Any) -> None:
        model = here(stock)
        set_values(model, 2)
        obs = {"_observation": np.zeros(3, np.float32), "advice": np.array([0, 0, 0, 1], np.float32)}
        assert model.predict(obs, deterministic=True)[0] == 2
