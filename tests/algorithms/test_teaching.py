"""A simulated human teaches, and so does what an algorithm was when it was young (thesis 4.3.2, 6.1)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from agents_app.algorithms import teaching
from agents_app.algorithms.advice import combine, is_neutral, neutral_advice
from agents_app.algorithms.builder import build
from agents_app.algorithms.spec import AgentSpec
from agents_app.algorithms.teaching import Advised, Human, Judged, advice_of, self_transfer, shaped_by
from agents_app.algorithms.weights import flatten
from tests.algorithms.games import Grid, Identity, Point
from tests.algorithms.specs import IMAGE, make_spec
from tests.algorithms.test_learning import PAIRS

UP, RIGHT, DOWN = 2, 1, 3
POLICY_GRADIENT: dict[str, Any] = {"net_arch": "16", "learning_rate": 0.01, "n_episodes": 4, "n_steps": 200}


def way(seen: Any) -> int:
    """Through Grid: to the right wall, then down."""
    return RIGHT if seen % 4 < 3 else DOWN


def human(**options: Any) -> Human:
    """Somebody who knows the way through Grid."""
    return Human(way, actions=4, wrong=lambda seen: UP, seed=1, **options)


def advised(env: Any, method: str = "intersection") -> Any:
    """Policy Gradient where somebody advises."""
    return build(AgentSpec("PolicyGradient", 4, 16, parameters=POLICY_GRADIENT, advice_method=method), env, 1)


def returns(algorithm: Any) -> np.ndarray:
    """Of its last hundred episodes."""
    return np.array([episode["r"] for episode in algorithm.ep_info_buffer])


class Nobody(Advised):
    """Advises nothing."""

    def __init__(self, env: Any) -> None:
        nothing = neutral_advice(env.action_space)
        super().__init__(env, lambda obs: nothing)


class Gallery(Identity):
    """Images instead of numbers, with their channels last."""

    def __init__(self) -> None:
        super().__init__()
        self.observation_space = spaces.Box(0, 255, (36, 36, 3), np.uint8)

    def _draw(self) -> Any:
        return self.np_random.integers(0, 256, (36, 36, 3)).astype(np.uint8)

    def _reward(self, action: Any) -> float:
        return 0.0


class TestAdviceOfAHuman:
    def test_it_is_given_and_right_as_often_as_said(self) -> None:
        somebody, said = human(attentive=0.3, knowing=0.75), [0, 0, 0]
        for _ in range(4000):
            advice = somebody.advise(5)
            said[2 if is_neutral(advice).all() else int(advice[UP] == 1)] += 1
            assert is_neutral(advice).all() or sorted(advice) == [0, 0, 0, 1]
        right, wrong, nothing = said
        assert nothing / 4000 == pytest.approx(0.7, abs=0.03)
        assert right / (right + wrong) == pytest.approx(0.75, abs=0.05)

    def test_it_is_drawn_alike_from_the_same_seed(self) -> None:
        one, other = human(attentive=0.5, knowing=0.5), human(attentive=0.5, knowing=0.5)
        assert [one.advise(0).tolist() for _ in range(50)] == [other.advise(0).tolist() for _ in range(50)]

    def test_it_ends_when_all_is_said(self) -> None:
        somebody = human(pieces=3)
        assert [bool(is_neutral(somebody.advise(0)).all()) for _ in range(5)] == [False] * 3 + [True] * 2
        assert somebody.said == 3

    def test_whoever_may_be_wrong_has_something_wrong_to_say(self) -> None:
        with pytest.raises(ValueError, match="something wrong to say"):
            Human(way, actions=4, knowing=0.9)

    def test_it_leads_a_beginner_to_the_goal(self) -> None:
        """Who always obeys arrives by the shortest way, with a return of 14, though nothing has been learned."""
        assert returns(advised(Advised(Grid(), human().advise)).learn(200)).min() == 14

    def test_a_twentieth_of_it_is_better_than_none(self) -> None:
        taught = returns(advised(Advised(Grid(), human(attentive=0.05).advise)).learn(1500))
        alone = returns(advised(Advised(Grid(), human(attentive=0.0).advise)).learn(1500))
        assert taught.mean() > alone.mean()

    def test_what_was_learned_stays_when_it_ends(self) -> None:
        """And there is enough to learn without an advisor."""
        somebody = human(pieces=300, attentive=0.5)
        assert returns(advised(Advised(Grid(), somebody.advise)).learn(4000))[-20:].mean() > 10
        assert somebody.said == 300


class TestRewardOfAHuman:
    def test_what_is_not_right_is_punished(self) -> None:
        somebody = human()
        assert [somebody.judge(0, action) for action in range(4)] == [-5.0, 0.0, -5.0, -5.0]
        assert somebody.said == 3

    def test_it_is_added_to_the_reward_for_what_was_seen_before(self) -> None:
        env = Judged(Grid(), human(pieces=2).judge)
        env.reset(seed=1)
        rewards = [env.step(action)[1] for action in (RIGHT, DOWN, UP, UP, RIGHT)]
        assert rewards == [-1, -6, -6, -1, -1]

    def test_it_is_learned_from(self) -> None:
        """Where the environment rewards nothing."""

        class Unrewarded(Identity):
            def _reward(self, action: Any) -> float:
                return 0.0

        env = Judged(Unrewarded(4), Human(int, actions=4, seed=1).judge)
        spec = AgentSpec("PolicyGradient", 4, 4, parameters={"net_arch": "16", "learning_rate": 0.02, "gamma": 0.0})
        assert returns(build(spec, env, 1).learn(1500))[-10:].mean() > -5  # of 10 steps; at random -37.5


def test_an_advisor_rewards_by_how_probable_an_action_is() -> None:
    judge = shaped_by(lambda obs: combine([np.array([0.7, 0.2, 0.1], np.float32)], 1.0))
    assert [judge(0, action) for action in range(3)] == pytest.approx([0.7, 0.2, 0.1], abs=1e-5)
    assert shaped_by(lambda obs: neutral_advice(spaces.Discrete(3)))(0, 1) == 0.0


class TestSelfTransfer:
    @pytest.mark.parametrize(
        ("name", "kind", "episodes"), [("PPO", "choice", 60), ("BDPI", "choice", 30), ("SAC", "number", 50)]
    )
    def test_who_begins_anew_begins_where_its_younger_self_ended(
        self, name: str, kind: str, episodes: int, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        made: list[Any] = []
        monkeypatch.setattr(teaching, "build", lambda *args: made.append(build(*args)) or made[-1])  # type: ignore[func-returns-value]
        space: Any = 3 if kind == "choice" else [[1], -1, 1]
        env: Any = Identity() if kind == "choice" else Point()
        spec = AgentSpec(name, space, space, parameters=PAIRS[name, kind][0], advice_method="intersection")
        fresh = self_transfer(spec, env, 1, episodes)
        first, weights = made[0], flatten(made[0].policy).copy()
        assert len(made) == 2 and fresh is made[1]
        assert (fresh.num_timesteps, fresh._n_updates, first.num_timesteps) == (0, 0, 10 * episodes)
        assert not np.array_equal(flatten(fresh.policy), weights)
        fresh.learn(100)
        beginning, alone = returns(fresh).mean(), returns(first)[:10].mean()
        assert beginning > alone + (2 if kind == "choice" else 1)
        assert np.array_equal(flatten(first.policy), weights)

    def test_it_sees_images_as_the_environment_shows_them(self) -> None:
        spec = make_spec("PPO", 3, IMAGE, advice_method="intersection")
        fresh = self_transfer(spec, Gallery(), 1, 2)
        assert fresh.learn(32).num_timesteps == 32

    @pytest.mark.parametrize("name", ["PPO", "A2C", "TRPO", "PolicyGradient", "SAC", "TD3"])
    def test_of_numbers_too_whatever_was_learned_last(self, name: str) -> None:
        model = build(make_spec(name, [[1], -1, 1], [[1], -1, 1], advice_method="intersection"), Nobody(Point()), 1)
        advice = advice_of(model.learn(64))(np.zeros(1, np.float32))
        assert advice.shape == (2,) and advice[1] > 0

    def test_the_advisor_is_frozen(self) -> None:
        model = advised(Advised(Grid(), human(attentive=0.5).advise))
        advise = advice_of(model)
        before = advise(np.int64(3))
        model.learn(400)
        assert np.array_equal(advise(np.int64(3)), before)
        assert not np.allclose(advice_of(model)(np.int64(3)), before)

    @pytest.mark.parametrize(("name", "method"), [("PPO", "none"), ("PPO", "shaping"), ("MaskablePPO", "intersection")])
    def test_it_needs_advice(self, name: str, method: str) -> None:
        with pytest.raises(ValueError, match="takes advice"):
            self_transfer(AgentSpec(name, 3, 3, advice_method=method), Identity(), 1, 10)
