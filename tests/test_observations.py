"""What JSON gives becomes what the spaces say, or is refused with a sentence."""

import gymnasium
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents_app.spaces import parse_space
from envs_app.errors import InvalidObservation, InvalidRequest, InvalidReward
from envs_app.observations import read_mask, read_observation, read_reward, write_action

VECTOR = [[3], -1, 1]
IMAGE = [[2, 2, 1], 0, 255]
SENSORS = {"place": 4, "speed": [[2], -1, 1], "camera": IMAGE}

anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.sampled_from([10**400, -(10**400), 1e39]),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text() | st.sampled_from(list(SENSORS)), inner, max_size=3)
    ),
    max_leaves=20,
)


def read(spec, value):
    return read_observation(parse_space(spec), value)


def refusal(spec, value) -> str:
    with pytest.raises(InvalidObservation) as refused:
        read(spec, value)
    return refused.value.detail


def test_it_reads_a_vector():
    read_vector = read(VECTOR, [1, -0.5, 0.25])
    assert read_vector.dtype == np.float32
    assert read_vector.tolist() == [1.0, -0.5, 0.25]


def test_it_reads_an_image():
    image = read(IMAGE, [[[0], [255]], [[7], [1]]])
    assert image.dtype == np.uint8
    assert image.tolist() == [[[0], [255]], [[7], [1]]]


def test_it_reads_several_sensors():
    read_sensors = read(SENSORS, {"camera": [[[0], [1]], [[2], [3]]], "place": 3, "speed": [0, 0.5]})
    assert read_sensors["place"] == 3
    assert read_sensors["speed"].tolist() == [0, 0.5]
    assert read_sensors["camera"].shape == (2, 2, 1)


@pytest.mark.parametrize("value", [0, 3, 3.0])
def test_it_reads_one_of_n_states_also_as_a_float(value):
    assert read(4, value) == int(value)
    assert type(read(4, value)) is int


def test_values_outside_the_bounds_are_taken_since_bounds_are_often_guesses():
    assert read(VECTOR, [100, -100, 0]).tolist() == [100, -100, 0]


def test_what_is_read_can_be_written_to_by_wrappers():
    vector, image = read(VECTOR, [1, 2, 3]), read(IMAGE, [[[0], [1]], [[2], [3]]])
    vector[0] = image[0] = 5
    assert vector.tolist() == [5, 2, 3]
    assert image.tolist() == [[[5], [5]], [[2], [3]]]


@pytest.mark.parametrize(
    ("spec", "value", "words"),
    [
        (VECTOR, [1, 2], "obs is a list of 2; a list of 3 is expected, for the shape [3]."),
        (VECTOR, 1, "obs is 1; a list of 3 is expected, for the shape [3]."),
        (VECTOR, [1, "2", 3], "obs[1] is the text '2'; a finite number is expected."),
        (VECTOR, [1, 2, True], "obs[2] is true; a finite number is expected."),
        (VECTOR, [None, 2, 3], "obs[0] is null; a finite number is expected."),
        (VECTOR, [0, 2, float("nan")], "obs[2] is nan; a finite number is expected."),
        (VECTOR, [0, 1e39, 0], "obs[1] is 1e+39; a finite number is expected."),
        (VECTOR, [10**400, 0, 0], "obs[0] is a whole number of more than 20 digits; a finite number is expected."),
        (VECTOR, [[1], 2, 3], "obs[0] is a list of 1; a finite number is expected."),
        (IMAGE, [[[0], [1]], [[2]]], "obs[1] is a list of 1; a list of 2 is expected, for the shape [2, 2, 1]."),
        (IMAGE, [[[0], [1]], [[2], []]], "obs[1][1] is a list of 0; a list of 1 is expected, for the shape [2, 2, 1]."),
        (IMAGE, [[[0], [1]], [[2], [256]]], "obs[1][1][0] is 256; a whole number from 0 to 255 is expected."),
        (IMAGE, [[[0], [1.0]], [[2], [3]]], "obs[0][1][0] is 1.0; a whole number from 0 to 255 is expected."),
        (4, 4, "obs is 4; a whole number from 0 to 3 is expected."),
        (4, -1, "obs is -1; a whole number from 0 to 3 is expected."),
        (4, 1.5, "obs is 1.5; a whole number from 0 to 3 is expected."),
        (4, True, "obs is true; a whole number from 0 to 3 is expected."),
        (4, {}, "obs is an object; a whole number from 0 to 3 is expected."),
        (SENSORS, [], "obs is a list of 0; an object with the keys camera, place, speed is expected."),
        (
            {"a": 2, "b": 2},
            {"a": 1, "c": 1},
            "obs lacks 'b' and has an unknown 'c'; an object with exactly the keys a, b is expected.",
        ),
        ({"a": VECTOR}, {"a": [1, 2, "x"]}, "obs.a[2] is the text 'x'; a finite number is expected."),
    ],
)
def test_a_refusal_says_which_key_what_came_and_what_was_expected(spec, value, words):
    assert refusal(spec, value) == words


def test_a_list_nested_a_thousand_deep_is_refused():
    value = []
    for _ in range(5000):
        value = [value]
    assert "a list of 3 is expected" in refusal(VECTOR, value)
    assert refusal(VECTOR, [value, 1, 2]) == "obs[0] is a list of 1; a finite number is expected."


@given(anything, st.sampled_from([4, VECTOR, IMAGE, SENSORS, [[2, 2], -1, 1]]))
def test_any_value_is_read_or_refused(value, spec):
    space = parse_space(spec)
    try:
        observation = read_observation(space, value)
    except InvalidObservation as refused:
        assert refused.detail.endswith(".")
    else:
        assert_within(space, observation)


def assert_within(space: gymnasium.Space, observation):
    """Of the space's type and shape, and finite."""
    if isinstance(space, gymnasium.spaces.Dict):
        assert observation.keys() == space.spaces.keys()
        for key, sub in space.spaces.items():
            assert_within(sub, observation[key])
    elif isinstance(space, gymnasium.spaces.Box):
        assert (observation.shape, observation.dtype) == (space.shape, space.dtype)
        assert np.isfinite(observation).all()
    else:
        assert space.contains(observation)


@given(st.sampled_from([4, VECTOR, IMAGE, SENSORS]).map(parse_space), st.integers(0, 1000))
def test_what_a_space_draws_is_read_as_it_was(space, seed):
    space.seed(seed)
    drawn = space.sample()
    assert space.contains(read_observation(space, as_json(drawn)))


def as_json(drawn):
    return {key: as_json(value) for key, value in drawn.items()} if isinstance(drawn, dict) else drawn.tolist()


@pytest.mark.parametrize("reward", [0, 1, -2.5, 3.4e38])
def test_it_reads_a_reward(reward):
    assert read_reward(reward) == reward
    assert type(read_reward(reward)) is float


@pytest.mark.parametrize("reward", [None, True, "1", [], {}, float("nan"), float("inf"), 1e39, 10**400, -(10**400)])
def test_it_refuses_a_reward_that_is_no_finite_number(reward):
    with pytest.raises(InvalidReward, match=r"reward is .*; a finite number is expected"):
        read_reward(reward)


def test_it_reads_a_mask():
    assert read_mask([True, False, True], 3).tolist() == [True, False, True]


@pytest.mark.parametrize("mask", [None, 1, [], [True], [True, 1, False], [True, None, True], [False] * 3, "yes"])
def test_it_refuses_a_mask_that_is_none(mask):
    with pytest.raises(InvalidRequest, match="action_mask"):
        read_mask(mask, 3)


def test_it_writes_actions():
    assert write_action(parse_space(4), np.array(2)) == 2
    assert write_action(parse_space(4), np.array([2])) == 2
    assert write_action(parse_space([[2], -1, 1]), np.array([[0.5, -0.25]], dtype=np.float32)) == [0.5, -0.25]
