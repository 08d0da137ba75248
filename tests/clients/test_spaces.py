"""The Python client writes Gymnasium's spaces as the server reads them."""

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from shepherd_client import spaces_of
from shepherd_client.spaces import check_spaces, from_wire, note, to_wire

from agents_app.spaces import parse_space
from envs_app.observations import read_observation

SENSORS = spaces.Dict({"camera": spaces.Box(0, 255, (8, 8, 3), np.uint8), "speed": spaces.Box(0, 1, (1,))})


@pytest.mark.parametrize(
    "space",
    [
        spaces.Discrete(5),
        spaces.Box(-1, 1, (3,)),
        spaces.Box(np.array([-4.8, 0], np.float32), np.array([4.8, 0.41887903], np.float32)),
        spaces.Box(np.array([[0, -1], [0, -2]], np.float32), np.float32(7), (2, 2)),
        spaces.Box(0, 255, (8, 8, 3), np.uint8),
        spaces.Box(0, 255, (4,), np.float32),
        SENSORS,
    ],
    ids=str,
)
def test_the_server_understands_the_same_space(space: spaces.Space) -> None:
    assert parse_space(note(space)) == space


def test_a_space_without_a_word_is_refused_with_advice() -> None:
    with pytest.raises(ValueError, match="FlattenObservation"):
        spaces_of(gymnasium.make("Blackjack-v1"))  # a tuple


@pytest.mark.parametrize("name", ["CartPole-v1", "LunarLander-v3", "Pendulum-v1", "Taxi-v4"])
def test_observations_of_real_environments_fit_their_notes(name: str) -> None:
    env = gymnasium.make(name)
    obs, _ = env.reset(seed=1)
    sent = to_wire(env.observation_space, obs)
    read = read_observation(parse_space(spaces_of(env).observation_space), getattr(sent, "tolist", lambda: sent)())
    np.testing.assert_array_equal(read, obs)


def test_infinite_bounds_become_large_ones() -> None:
    low, high = note(spaces.Box(-np.inf, np.inf, (2,)))[1:]
    assert (low, high) == (-3.4e38, 3.4e38)


def test_discrete_spaces_begin_at_zero_on_the_wire() -> None:
    space = spaces.Discrete(3, start=-1)
    assert to_wire(space, np.int64(-1)) == 0
    assert from_wire(space, 2) == 1


def test_box_actions_are_arrays_of_the_space() -> None:
    action = from_wire(spaces.Box(-1, 1, (2,), np.float64), [0.5, -1])
    assert action.dtype == np.float64
    assert action.tolist() == [0.5, -1]


@pytest.mark.parametrize(
    ("action_space", "observation_space", "fits"),
    [
        (2, [[4], -10, 10], True),  # other bounds of an observation do no harm
        (3, [[4], -10, 10], False),
        (2, [[5], -10, 10], False),
        ([[1], -1, 1], [[4], -10, 10], False),
        (2, {"state": [[4], -10, 10]}, False),
    ],
)
def test_an_agent_for_another_environment_is_refused(
    action_space: object, observation_space: object, fits: bool
) -> None:
    env = gymnasium.make("CartPole-v1")
    agent = {"name": "Somebody", "action_space": action_space, "observation_space": observation_space}
    if fits:
        return check_spaces(env, agent)
    with pytest.raises(ValueError, match="'Somebody' is for another environment"):
        check_spaces(env, agent)
    return None


def test_the_bounds_of_actions_must_be_the_same() -> None:
    env = gymnasium.make("Pendulum-v1")
    agent = {"name": "Somebody", "observation_space": [[3], -10, 10]}
    check_spaces(env, agent | {"action_space": [[1], -2, 2]})
    with pytest.raises(ValueError, match="another environment"):
        check_spaces(env, agent | {"action_space": [[1], -1, 1]})
