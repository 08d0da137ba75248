"""Spaces, algorithm and policy of an agent must fit together; the refusal says what to write."""

import pytest
from django.core.exceptions import ValidationError

from agents_app.checks_agent import check_fixed
from agents_app.models import Algorithm
from tests.agents.unsaved import DICTIONARY, IMAGE, REAL, SMALL, VECTOR, agent, refusal

pytestmark = pytest.mark.django_db


@pytest.mark.parametrize(
    ("algorithm", "action_space", "observation_space", "policy"),
    [
        ("PPO", 4, VECTOR, "auto"),
        ("PPO", REAL, IMAGE, "CnnPolicy"),
        ("PPO", 4, SMALL, "auto"),
        ("PPO", 4, IMAGE, "MlpPolicy"),
        ("A2C", 4, DICTIONARY, "MultiInputPolicy"),
        ("DQN", 2, 16, "auto"),
        ("SAC", REAL, DICTIONARY, "auto"),
        ("CrossQ", REAL, VECTOR, "auto"),
        ("ARS", 2, VECTOR, "LinearPolicy"),
        ("BDPI", 4, DICTIONARY, "auto"),
        ("PolicyGradient", REAL, IMAGE, "CnnPolicy"),
        ("RecurrentPPO", 2, IMAGE, "CnnLstmPolicy"),
    ],
)
def test_what_fits_is_taken(algorithm, action_space, observation_space, policy):
    agent(algorithm, action_space, observation_space, policy).full_clean()


@pytest.mark.parametrize(
    ("space", "sentence"),
    [
        ("four", "write a number of choices"),
        (True, "write a number of choices"),
        (0, "from 1 to"),
        ([[8], -10], "this one has 2"),
        ([[8], 10, -10], "less than its high"),
        ([[8], -1e999, 10], "must be finite"),
        ([[8], float("nan"), 10], "must be finite"),
        ([[8], 10**400, 10], "large"),
        ({"advice": 2}, "choose another"),
        ({"action_mask": [[3], 0, 1], "seen": 2}, "choose another"),
        ({"a": {"b": 2}}, "a key of its own"),
    ],
)
def test_it_refuses_what_is_no_space(space, sentence):
    assert sentence in refusal("observation_space", observation_space=space)


@pytest.mark.parametrize(
    ("algorithm", "space", "sentence"),
    [
        ("DQN", REAL, "write a whole number n"),
        ("BDPI", REAL, "write a whole number n"),
        ("SAC", 4, "write [shape, low, high]"),
        ("PPO", {"a": 2}, "cannot be a dictionary"),
        ("SAC", [[2], -1e300, 1e300], "write smaller ones"),
        ("SAC", [[2], 0, 255], "write 0.0 and 255.0"),
    ],
)
def test_it_refuses_actions_that_the_algorithm_cannot_choose(algorithm, space, sentence):
    assert sentence in refusal("action_space", algorithm=algorithm, action_space=space)


@pytest.mark.parametrize(
    ("algorithm", "space", "policy", "sentence"),
    [
        ("PPO", VECTOR, "CnnPolicy", "write auto or MlpPolicy"),
        ("PPO", SMALL, "CnnPolicy", "36 by 36"),
        ("PPO", DICTIONARY, "MlpPolicy", "write auto or MultiInputPolicy"),
        ("PPO", VECTOR, "MultiInputPolicy", "write auto or MlpPolicy"),
        ("PPO", VECTOR, "MlpLstmPolicy", "PPO has no MlpLstmPolicy"),
        ("ARS", VECTOR, "CnnPolicy", "write auto or LinearPolicy or MlpPolicy"),
    ],
)
def test_it_refuses_a_network_that_does_not_fit(algorithm, space, policy, sentence):
    assert sentence in refusal("policy", algorithm=algorithm, observation_space=space, policy=policy)


@pytest.mark.parametrize(
    ("algorithm", "action_space", "space"),
    [
        ("CrossQ", REAL, IMAGE),
        ("BDPI", 4, IMAGE),
        ("CrossQ", REAL, DICTIONARY),
        ("ARS", 2, IMAGE),
        ("PPO", 2, {"eye": SMALL}),
    ],
)
def test_it_refuses_observations_without_a_network(algorithm, action_space, space):
    assert "write" in refusal(
        "observation_space", algorithm=algorithm, action_space=action_space, observation_space=space
    )


def test_an_algorithm_that_is_no_longer_listed_takes_no_new_agents():
    Algorithm.objects.filter(name="PPO").update(listed=False)
    assert "choose another" in refusal("algorithm")


def test_the_algorithm_is_fixed():
    saved = agent()
    saved.save()
    saved.algorithm = Algorithm.objects.get(name="A2C")
    with pytest.raises(ValidationError, match="make a new agent"):
        saved.full_clean()


def test_spaces_are_fixed_once_it_has_learned():
    saved = agent()
    saved.save()
    saved.action_space = 5
    saved.full_clean()
    saved.current_run().executions.create(number=1)
    with pytest.raises(ValidationError, match="reset its learning"):
        saved.full_clean()


@pytest.mark.parametrize("algorithm", ["PPO", "A2C", "TRPO", "PolicyGradient"])
@pytest.mark.parametrize("bounds", [(20, 30), (-9, -3), (0, 1000)])
def test_actions_that_would_not_be_found_are_refused_to_a_new_agent(algorithm, bounds):
    assert "have your client scale" in refusal("action_space", algorithm=algorithm, action_space=[[1], *bounds])
    agent("SAC", [[1], *bounds]).full_clean()
    agent(algorithm, [[2], [0, -1], [5, 1]]).full_clean()
    old = agent(algorithm, [[1], *bounds])
    old.save()
    old.full_clean()


@pytest.mark.parametrize("name", ["psi", "rho", "advice_weight", "shaping_scale", "unanswered_reward"])
@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_numbers_are_finite(name, value):
    refusal(name, **{name: value})


def test_an_algorithm_that_plays_itself_ends_no_episode_for_a_client():
    assert "write 0" in refusal("answer_within", algorithm="ARS", answer_within=9)


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"algorithm": "SAC", "action_space": REAL, "action_features": [[1.0]]}, "leave it empty"),
        ({"algorithm": "BDPI", "action_features": [[1.0]] * 4}, "choose e.g. DQN"),
        ({"action_features": [[1.0]] * 3}, "Write 4 rows"),
        ({"action_features": [[1.0], [1.0], [1.0], [1.0, 2.0]]}, "Write 4 rows"),
        ({"action_features": [[]] * 4}, "Write 4 rows"),
        ({"action_features": [[True]] * 4}, "Write 4 rows"),
        ({"action_features": [["red"]] * 4}, "Write 4 rows"),
        ({"action_features": [[1e39]] * 4}, "finite"),
        ({"action_features": {"0": [1.0]}}, "Write 4 rows"),
    ],
)
def test_it_refuses_features_of_actions_that_are_no_table(fields, sentence):
    assert sentence in refusal("action_features", **fields)


def test_it_takes_a_row_of_features_for_each_action():
    agent(algorithm="DQN", action_features=[[1, 0.5], [0, 1], [0, 0], [-1, 1]]).full_clean()


def test_features_of_actions_stay_once_the_agent_has_learned(monkeypatch):
    before, after = (agent(action_features=[[number]] * 4) for number in (0, 1))
    monkeypatch.setattr(after, "has_learned", lambda: True)
    with pytest.raises(ValidationError) as caught:
        check_fixed(before, after)
    assert set(caught.value.message_dict) == {"action_features"}
