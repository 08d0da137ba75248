"""Parameters must suit the agent's spaces, its advice and each other; the refusal says what to write."""

import pytest
from django.core.exceptions import ValidationError

from agents_app import services
from tests.agents.unsaved import DICTIONARY, REAL, agent

pytestmark = pytest.mark.django_db


@pytest.mark.parametrize(
    ("fields", "values", "name"),
    [
        ({}, {"use_sde": True}, "use_sde"),
        ({"algorithm": "DQN", "observation_space": DICTIONARY}, {"n_steps": 3}, "n_steps"),
        ({"algorithm": "ARS"}, {"net_arch": "64"}, "net_arch"),
        ({"algorithm": "ARS"}, {"n_top": 9}, "n_top"),
        ({"algorithm": "MaskablePPO"}, {"n_steps": 65}, "batch_size"),  # a deviation over one step is no number
        ({"algorithm": "RecurrentPPO"}, {"batch_size": 1}, "batch_size"),
        ({"algorithm": "CrossQ", "action_space": REAL}, {"batch_size": 1}, "batch_size"),
        ({"algorithm": "TRPO"}, {"n_steps": 16, "sub_sampling_factor": 9}, "sub_sampling_factor"),
        ({"algorithm": "DQN"}, {"gradient_steps": 0}, "gradient_steps"),
        ({"algorithm": "DQN", "observation_space": [[210, 160, 3], 0, 255]}, {"gamma": 0.9}, "buffer_size"),
        ({"algorithm": "SAC", "action_space": REAL}, {"ent_coef": "auto_0"}, "ent_coef"),
        ({"algorithm": "SAC", "action_space": REAL}, {"ent_coef": "1e400"}, "ent_coef"),
        ({"algorithm": "SAC", "action_space": REAL}, {"target_entropy": "-1e39"}, "target_entropy"),
        ({"algorithm": "SAC", "action_space": REAL}, {"action_noise": "normal 1e39"}, "action_noise"),
    ],
)
def test_parameters_must_suit_the_spaces(fields, values, name):
    saved = agent(**fields)
    saved.save()
    with pytest.raises(ValidationError) as caught:
        services.set_parameters(saved, values)
    assert list(caught.value.message_dict) == [name]
    assert saved.own_parameters() == {}


@pytest.mark.parametrize(
    ("algorithm", "values"),
    [
        ("PPO", {"n_steps": 65}),  # it leaves one step as it is
        ("RecurrentPPO", {"n_steps": 65, "batch_size": 64, "normalize_advantage": False}),
        ("MaskablePPO", {"n_steps": 66}),
        ("TRPO", {"n_steps": 16, "sub_sampling_factor": 8}),
    ],
)
def test_of_two_steps_or_where_nothing_is_compared_updates_may_be_made(algorithm, values):
    saved = agent(algorithm, 3)
    saved.save()
    services.set_parameters(saved, values)
    assert saved.own_parameters() == values


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


@pytest.mark.parametrize("algorithm", ["TD3", "DDPG"])
def test_advice_by_samples_needs_to_know_how_probable_actions_are(algorithm):
    by_samples = {"advice_method": "intersection", "continuous_advice": "sampling"}
    one = agent(algorithm, REAL, **by_samples)
    one.save()
    for none in ("", "normal 0", "ou 0.0", "normal 1e-50"):
        with pytest.raises(ValidationError) as caught:
            services.set_parameters(one, {"action_noise": none})
        assert "write e.g. normal 0.1" in caught.value.message_dict["action_noise"][0]
    services.set_parameters(one, {"action_noise": "normal 0.2"})
    for other in (agent(algorithm, REAL), agent("SAC", REAL, **by_samples)):
        other.name = other.algorithm.name
        other.save()
        services.set_parameters(other, {"action_noise": ""})


def test_a_learning_rate_falls_and_does_not_rise():
    one = agent("PPO")
    one.save()
    services.set_parameters(one, {"learning_rate_end": 0.0003})
    for changes in ({"learning_rate_end": 0.001}, {"learning_rate": 0.0001}):
        with pytest.raises(ValidationError) as caught:
            services.set_parameters(one, changes)
        assert "Write at most the learning_rate" in caught.value.message_dict["learning_rate_end"][0]
    services.set_parameters(one, {"learning_rate": 0.0001, "learning_rate_end": 0.0})
