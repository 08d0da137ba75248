"""Agents that are not saved yet, to be checked."""

import pytest
from django.core.exceptions import ValidationError

from agents_app.models import Agent, Algorithm, User

VECTOR, IMAGE, SMALL, DICTIONARY = (
    [[8], -10, 10],
    [[84, 84, 3], 0, 255],
    [[20, 20, 3], 0, 255],
    {"a": [[3], -1, 1], "b": 5},
)
REAL = [[2], -1, 1]


def agent(algorithm="PPO", action_space=4, observation_space=None, policy="auto", **advice):
    owner, _ = User.objects.get_or_create(name="owner")
    return Agent(
        owner=owner,
        name="agent",
        algorithm=Algorithm.objects.get(name=algorithm),
        action_space=action_space,
        observation_space=VECTOR if observation_space is None else observation_space,
        policy=policy,
        **advice,
    )


def refusal(field, **fields):
    with pytest.raises(ValidationError) as caught:
        agent(**fields).full_clean()
    assert set(caught.value.message_dict) == {field}
    return " ".join(caught.value.message_dict[field])
