"""The environments that come with the clients."""

from collections import deque
from collections.abc import Callable
from functools import partial

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from shepherd_environments import SIZES, ContinuousAcrobot, FiveRooms, SimulatedPerson, Thermostat


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


OURS = ["Thermostat-v0", "ContinuousAcrobot-v0"]
OURS += [f"{name}-{size}-v0" for name in ("FiveRooms", "FiveRoomsCheap") for size in SIZES]


@pytest.mark.parametrize("name", OURS)
def test_it_is_a_gymnasium_environment(name: str) -> None:
    check_env(gymnasium.make(f"shepherd_environments:{name}").unwrapped)


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


# --- Five Rooms ---
def steps_to(env: FiveRooms, goal: tuple[int, int]) -> int:
    """The length of the shortest way from the start, by breadth-first search."""
    far, queue = {env.start: 0}, deque([env.start])
    while goal not in far:
        cell = queue.popleft()
        for there in (env.neighbour(cell, action) for action in range(4)):
            if there not in far:
                far[there] = far[cell] + 1
                queue.append(there)
    return far[goal]


def optimum(env: FiveRooms) -> tuple[int, float]:
    """Steps and return of the shortest way."""
    steps = steps_to(env, env.goal)
    return steps, (steps - 1) * env.step_reward + env.goal_reward


@pytest.mark.parametrize(
    ("size", "rewards", "steps", "best"),
    [("29x27", "cheap", 54, 94.6), ("29x27", "dear", 54, 47), ("23x21", "dear", 44, 57), ("14x12", "dear", 26, 75)],
)
def test_the_optima_of_five_rooms_are_the_stated_ones(size: str, rewards: str, steps: int, best: float) -> None:
    assert optimum(FiveRooms(size, rewards)) == (steps, pytest.approx(best))


def test_walking_the_shortest_way_earns_the_optimum() -> None:
    env = gymnasium.make("shepherd_environments:FiveRoomsCheap-29x27-v0")
    env.reset()
    way = [3] * 10 + [1] * 4 + [3] * 9 + [1] * 10 + [3] * 3 + [1] * 14 + [3] * 4
    outcomes = [env.step(action) for action in way]
    assert [terminated for _, _, terminated, _, _ in outcomes] == [False] * 53 + [True]
    assert sum(float(reward) for _, reward, _, _, _ in outcomes) == pytest.approx(94.6)
    assert outcomes[-1][0] == 29 * 27 - 1


def test_five_rooms_ends_after_500_steps() -> None:
    env = gymnasium.make("shepherd_environments:FiveRooms-14x12-v0")
    env.reset()
    outcomes = [env.step(0) for _ in range(500)]
    assert [truncated for _, _, _, truncated, _ in outcomes] == [False] * 499 + [True]
    assert {reward for _, reward, _, _, _ in outcomes} == {-1.0}


def test_walls_hold() -> None:
    env = FiveRooms("14x12")
    env.reset(options={"cell": (0, 5)})
    assert env.step(3)[0] == env.step(0)[0] == 5


def test_the_goal_is_reached_through_any_of_676_pairs_of_doors() -> None:
    columns = [column for column in range(27) if column != 13]
    lengths = [optimum(FiveRooms(doors=(first, second)))[0] for first in columns for second in columns]
    assert (len(lengths), min(lengths)) == (676, 54)


@pytest.mark.parametrize("column", [13, -1, 27])
def test_no_door_is_where_the_walls_meet_or_outside(column: int) -> None:
    with pytest.raises(ValueError, match="no door"):
        FiveRooms(doors=(column, 3))


def test_the_map_of_five_rooms_shows_where_the_agent_is() -> None:
    env = FiveRooms("14x12")
    env.reset(options={"cell": (1, 1)})
    assert env.render().splitlines()[:2] == ["S.....#.....", ".@.........."]


# --- Acrobot ---
@pytest.mark.parametrize("torque", [-1, 0, 1])
def test_whole_torques_move_acrobot_as_gymnasiums_do(torque: int) -> None:
    ours, theirs = ContinuousAcrobot(), gymnasium.make("Acrobot-v1").unwrapped
    ours.reset(seed=4)
    theirs.reset(seed=4)
    for _ in range(20):
        np.testing.assert_array_equal(ours.step(np.array([torque], np.float32))[0], theirs.step(torque + 1)[0])


def test_torques_are_continuous_and_cut_off_at_1() -> None:
    def after(torque: float) -> list[float]:
        env = ContinuousAcrobot()
        env.reset(seed=4)
        return env.step(np.array([torque], np.float32))[0].tolist()

    assert after(0.5) not in (after(0), after(1))
    assert after(7.0) == after(1.0)
