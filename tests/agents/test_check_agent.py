"""Spaces, algorithm and policy of an agent must fit together; the refusal says what to write."""

import pytest
from django.core.exceptions import ValidationError

from agents_app import services
from agents_app.models import Agent, Algorithm, User

pytestmark = pytest.mark.django_db
VECTOR, IMAGE, SMALL, DICTIONARY = (
    [[8], -10, 10],
    [[84, 84, 3], 0, 255],
    [[20, 20, 3], 0, 255],
    {"a": [[3], -1, 1], "b": 5},
)
REAL = [[2], -1, 1]


def agent(algorithm="PPO", action_space=4, observation_space=None, policy="auto"):
    owner, _ = User.objects.get_or_create(name="owner")
    return Agent(
        owner=owner,
        name="agent",
        algorithm=Algorithm.objects.get(name=algorithm),
        action_space=action_space,
        observation_space=VECTOR if observation_space is None else observation_space,
        policy=policy,
    )


def refusal(field, **fields):
    with pytest.raises(ValidationError) as caught:
        agent(**fields).full_clean()
    assert set(caught.value.message_dict) == {field}
    return " ".join(caught.value.message_dict[field])


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


@pytest.mark.parametrize(
    ("fields", "values", "name"),
    [
        ({}, {"use_sde": True}, "use_sde"),
        ({"algorithm": "DQN", "observation_space": DICTIONARY}, {"n_steps": 3}, "n_steps"),
        ({"algorithm": "ARS"}, {"net_arch": "64"}, "net_arch"),
        ({"algorithm": "ARS"}, {"n_top": 9}, "n_top"),
    ],
)
def test_parameters_must_suit_the_spaces(fields, values, name):
    saved = agent(**fields)
    saved.save()
    with pytest.raises(ValidationError) as caught:
        services.set_parameters(saved, values)
    assert list(caught.value.message_dict) == [name]
    assert saved.own_parameters() == {}


def test_parameters_are_the_defaults_and_the_owners_values():
    saved = agent()
    saved.save()
    services.set_parameters(saved, {"gamma": 0.9, "net_arch": "32"})
    assert saved.parameters()["gamma"] == 0.9
    assert saved.parameters()["net_arch"] == "32"
    assert saved.parameters()["n_steps"] == 2048
    assert "target_kl" not in saved.parameters()
    services.set_parameters(saved, {"gamma": None})
    assert saved.parameters()["gamma"] == 0.99
    with pytest.raises(ValidationError, match="PPO has no tau"):
        services.set_parameters(saved, {"tau": 1.0})
