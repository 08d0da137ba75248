"""The study of Bored in the city: its visitors, and who suggests places to them."""

from __future__ import annotations

from datetime import datetime
from typing import Any

import numpy as np
import pytest
from mabwiser.mab import MAB, LearningPolicy
from shepherd_environments.bored import CITY, allowed

from experiments.bored import curves
from experiments.bored.city import BEGIN, City, Suggestion
from experiments.bored.players import Chance, LinUCB, MostPopular, Oracle, Player, Thompson

SMALL: dict[str, Any] = {"learning_starts": 10, "batch_size": 8, "buffer_size": 500, "gamma": 0.0, "net_arch": "8"}


def played(player: Any, visitors: int = 3, seed: int = 1) -> tuple[City, list[tuple[Any, int]]]:
    """A small city, and what was suggested in it."""
    city, made = City(visitors, 1.0, seed), []
    suggests: Player = player(len(city.places), seed)
    for moment in city.moments:
        suggestion = city.suggestion(moment)
        place = suggests.suggest(suggestion)
        suggests.hear(suggestion, place, city.answer(suggestion, place))
        made.append((suggestion, place))
    suggests.close()
    return city, made


@pytest.mark.parametrize("player", [Chance, MostPopular, Oracle, LinUCB, Thompson])
def test_everybody_suggests_what_is_allowed(player: Any) -> None:
    city, made = played(player)
    assert all(suggestion.allowed[place] for suggestion, place in made)
    assert city.loved().shape == (3, 30)


@pytest.mark.parametrize("allowed_at", [(0, 3), (4, 22)])
def test_the_table_of_opening_hours_says_what_the_contract_says(allowed_at: tuple[int, int]) -> None:
    weekday, hour = allowed_at
    city = City(1, 1.0, 1)
    now = datetime(2026, 6, 8 + weekday, hour, 30, tzinfo=CITY)
    mask = city.suggestion((now, 0)).allowed
    assert mask.tolist() == allowed(city.places, now, {})
    assert not mask.all()


def test_a_quick_bandit_expects_what_its_library_does() -> None:
    bandit, rng = LinUCB(5, 1), np.random.default_rng(2)
    seen = [Suggestion(0, BEGIN, rng.random(29), np.ones(5, bool), np.zeros(5)) for _ in range(40)]
    for number, suggestion in enumerate(seen):
        bandit.hear(suggestion, number % 5, float(number % 3 == 0))
    plain = MAB(list(range(5)), LearningPolicy.LinUCB(alpha=bandit.alpha), seed=1)
    observations = np.array([[*suggestion.observation, 1.0] for suggestion in seen])
    nothing = [*np.zeros(29), 1.0]
    plain.fit([0], [0], [nothing])
    plain.partial_fit([number % 5 for number in range(40)], [float(n % 3 == 0) for n in range(40)], observations)
    expected = plain.predict_expectations(observations[:1])
    np.testing.assert_allclose(bandit.expected(observations[0]), [expected[arm] for arm in range(5)], atol=1e-9)


def test_an_execution_suggests_what_is_allowed_and_learns_from_every_answer() -> None:
    for executions, advice in ((1, "none"), (2, "intersection")):
        agent = curves.shepherd("DQN", SMALL, executions, advice_method=advice)
        _, made = played(agent, visitors=4)
        assert all(suggestion.allowed[place] for suggestion, place in made)


def test_a_city_is_the_same_whoever_suggests() -> None:
    one, other = City(5, 2.0, 7), City(5, 2.0, 7)
    assert one.moments == other.moments
    assert np.array_equal(one.suggestion(one.moments[0]).chances, other.suggestion(other.moments[0]).chances)
    assert not np.array_equal(one.visitors[0].kinds, City(5, 2.0, 8).visitors[0].kinds)


def test_who_knows_all_tastes_does_better_than_chance() -> None:
    knowing, guessing = (
        np.mean([played(player, 8, seed)[0].loved() for seed in (1, 2)]) for player in (Oracle, Chance)
    )
    assert knowing > guessing + 0.1
