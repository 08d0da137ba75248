"""The environments that come with the clients."""

from collections.abc import Callable
from functools import partial

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from shepherd_environments import SimulatedPerson, Thermostat


def constant(power: int, obs: np.ndarray) -> int:
    """A heater that nobody touches."""
    return power


def play_day(heat: Callable[[np.ndarray], int]) -> float:
    """The return of a day on which `heat` says the power from what is observed."""
    env = gymnasium.make("shepherd_environments:Thermostat-v0")
    obs, _ = env.reset(seed=3)
    total, truncated = 0.0, False
    while not truncated:
        obs, reward, _, truncated, _ = env.step(heat(obs))
        total += float(reward)
    return total


def test_the_thermostat_is_a_gymnasium_environment() -> None:
    check_env(gymnasium.make("shepherd_environments:Thermostat-v0").unwrapped)


def test_heating_warms_and_a_cold_heater_cools() -> None:
    env = Thermostat()
    env.reset(seed=1)
    start = env.temperature
    env.step(2)
    assert env.temperature > start
    warm = env.temperature
    env.step(0)
    assert env.outside < env.temperature < warm


def test_a_room_that_is_never_heated_ends_as_cold_as_it_is_outside() -> None:
    env = Thermostat()
    env.reset(seed=1)
    for _ in range(3000):
        env.step(0)
    assert env.temperature == pytest.approx(env.outside, abs=6)


def test_the_simulated_person_likes_21_degrees_only() -> None:
    person = SimulatedPerson(np.random.default_rng(1))
    assert {person.thumb(21.0) for _ in range(50)} == {0.0, 1.0}
    assert {person.thumb(25.0) for _ in range(50)} == {0.0, -1.0}


def test_a_thermostat_that_aims_at_21_degrees_beats_those_that_do_not_look() -> None:
    aiming = play_day(lambda obs: 2 if 20 + 10 * obs[0] < 21 else 0)
    off, half, full = (play_day(partial(constant, power)) for power in range(3))
    assert aiming > 20 + max(off, half, full)


def test_the_person_may_be_another_one() -> None:
    class Grumbler:
        def thumb(self, temperature: float) -> float:
            return -1.0

    env = Thermostat(Grumbler())
    env.reset(seed=1)
    assert env.step(0)[1] == -1.0
