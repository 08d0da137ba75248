"""Off the policy, advice changes what is drawn and nothing else: neutral advice not even that."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch as th
from hypothesis import given
from hypothesis import strategies as st
from sb3_contrib import QRDQN, TQC
from stable_baselines3 import DQN, SAC, TD3
from stable_baselines3.common.buffers import ReplayBuffer

from agents_app.algorithms.advice import neutral_advice
from agents_app.algorithms.explorers import draw_advice
from agents_app.algorithms.off_policy import OffPolicyActor
from tests.algorithms.building import built, some
from tests.algorithms.games import Advised, Point
from tests.algorithms.off_policy import ACTORS, EVERY, METHODS, VALUES, advised, draws, game, here, set_actor, small
from tests.algorithms.specs import OBSERVATIONS, make_spec


class TestNeutral:
    @pytest.mark.parametrize(
        ("stock", "method"),
        [
            *((stock, "intersection") for stock in (*VALUES, *ACTORS)),
            *((stock, method) for stock in (DQN, TD3) for method in ("reuse", "shaping")),
            (QRDQN, "union"),
            (SAC, "sampling"),
        ],
    )
    def test_two_hundred_steps_of_learning_are_those_of_the_stock_algorithm(self, stock: Any, method: str) -> None:
        plain = stock("MlpPolicy", game(stock), policy_kwargs={"net_arch": [8]}, **small(stock)).learn(200)
        ours = advised(stock, Advised(game(stock)), METHODS[method]).learn(200)
        assert ours._n_updates == plain._n_updates > 50
        ours_state, plain_state = ours.policy.state_dict(), plain.policy.state_dict()
        assert ours_state.keys() == plain_state.keys()
        assert all(th.equal(ours_state[name], plain_state[name]) for name in plain_state)
        for array in ("observations", "next_observations", "actions", "rewards", "dones"):
            assert np.array_equal(getattr(ours.replay_buffer, array), getattr(plain.replay_buffer, array))

    @EVERY
    def test_the_replay_buffer_keeps_no_advice(self, stock: Any) -> None:
        model = advised(stock, Advised(game(stock))).learn(50)
        assert type(model.replay_buffer) is ReplayBuffer
        assert model.observation_space == game(stock).observation_space == model.policy.observation_space

    @pytest.mark.parametrize("stock", [SAC, TQC])
    def test_exploration_by_gsde_is_the_stock_one_too(self, stock: Any) -> None:
        options = small(stock, use_sde=True, sde_sample_freq=4)
        plain = stock("MlpPolicy", Point(), policy_kwargs={"net_arch": [8]}, **options).learn(100)
        ours = advised(stock, Advised(Point()), use_sde=True, sde_sample_freq=4).learn(100)
        assert np.array_equal(ours.replay_buffer.actions, plain.replay_buffer.actions)

    @pytest.mark.parametrize("stock", ACTORS)
    @pytest.mark.parametrize("method", ["intersection", "sampling", "geometric", "reuse"])
    def test_a_component_without_advice_stays_the_learners_own(self, stock: Any, method: str) -> None:
        model = here(stock, METHODS[method])
        set_actor(model, [0.4, -0.2])
        own = draws(model, neutral_advice(model.action_space))
        half = draws(model, [2.0, 7.0, np.inf, 0.3])
        assert half[:, 0].mean() == pytest.approx(own[:, 0].mean(), abs=0.1)
        assert half[:, 0].std() == pytest.approx(own[:, 0].std(), rel=0.1)
        assert half[:, 1].mean() > own[:, 1].mean() + 0.5


class TestProperties:
    MODELS: dict[Any, Any] = {}

    @given(
        stock=st.sampled_from(ACTORS),
        method=st.sampled_from(["intersection", "geometric", "sampling", "reuse"]),
        learner=st.lists(st.floats(-100, 100), min_size=2, max_size=2),
        deviation=st.floats(1e-6, 7),
        means=st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=2),
        deviations=st.lists(st.floats(0, 1e6) | st.just(np.inf), min_size=2, max_size=2),
    )
    def test_actions_stay_finite_and_within_bounds(
        self, stock: Any, method: str, learner: Any, deviation: float, means: Any, deviations: Any
    ) -> None:
        model = self.MODELS.setdefault((stock, method), here(stock, METHODS[method]))
        set_actor(model, learner, deviation)
        actions = draws(model, [*means, *deviations], 5)
        assert all(model.action_space.contains(action) for action in actions.astype(np.float32))

    @given(
        stock=st.sampled_from(VALUES),
        method=st.sampled_from(["intersection", "geometric", "union", "reuse"]),
        rate=st.floats(0, 1),
        advice=st.lists(st.floats(0, 1, width=32), min_size=4, max_size=4).filter(any),
    )
    def test_some_action_is_always_chosen(self, stock: Any, method: str, rate: float, advice: Any) -> None:
        model = self.MODELS.setdefault((stock, method), here(stock, METHODS[method]))
        model.exploration_rate = rate
        assert all(model.action_space.contains(action) for action in draws(model, advice, 5))

    @given(deviations=st.lists(st.floats(0, 10) | st.just(np.inf), min_size=2, max_size=2))
    def test_draws_of_the_advisor_are_its_own_or_the_learners(self, deviations: Any) -> None:
        own = np.array([[0.25, -0.75], [0.5, 0.5]], np.float32)
        advice = np.tile(np.array([0.9, 0.9, *deviations], np.float32), (2, 1))
        drawn = draw_advice(own, advice, 6)
        assert drawn.shape == (6, 2, 2)
        silent = np.isinf(advice[:, 2:])
        assert np.array_equal(drawn[:, silent], np.tile(own[silent], (6, 1)))
        assert (np.abs(drawn) <= 1).all()


@pytest.mark.parametrize("kind", OBSERVATIONS)
@pytest.mark.parametrize("name", ["DQN", "QR-DQN", "SAC", "TD3"])
def test_executions_record_what_was_drawn_with_advice(name: str, kind: str) -> None:
    discrete = name in ("DQN", "QR-DQN")
    spec = make_spec(name, 3 if discrete else [[2], -2, 2], OBSERVATIONS[kind], advice_method="intersection")
    model = built(spec)
    actor = OffPolicyActor(model)
    advice = np.array([0, 0, 1] if discrete else [50, -50, 0.1, 0.1], np.float32)
    for obs in some(spec.observations(), 30):
        observed = {**(obs if isinstance(obs, dict) else {"_observation": obs}), "advice": advice}
        decision, _ = actor.decide(observed, None, None)
        assert decision.obs is observed
        assert decision.action == pytest.approx(2 if discrete else [2, -2], abs=0.1)
        assert np.array_equal(decision.replay[0][0], decision.action)
