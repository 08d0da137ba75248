"""Owners make agents."""

import pytest
from django.urls import reverse

from agents_app.models import Agent, Algorithm
from tests.admin.pages import errors, url


def test_an_agent_is_made_with_the_basics_and_belongs_to_who_made_it(client):
    data = {"name": "new", "algorithm": Algorithm.objects.get(name="SAC").pk}
    data |= {"action_space": "[[2], -1, 1]", "observation_space": "[[3], -1, 1]"}
    page = client.post(reverse("admin:agents_app_agent_add"), data, follow=True)
    agent = Agent.objects.get()
    assert (agent.owner.name, agent.action_space, agent.policy) == ("ann", [[2], -1, 1], "auto")
    assert agent.runs.count() == 1
    assert page.redirect_chain[-1][0] == url(agent)


@pytest.mark.parametrize(
    ("field", "value", "sentence"),
    [
        ("action_space", "[[2], -1", "This cannot be read: write e.g. 4"),
        ("action_space", "{}", "required"),
        ("action_space", "[[2], -1, 1]", "write a whole number n"),
        ("observation_space", "[[8], -Infinity, 1]", "must be finite"),
        ("observation_space", "[[8]]", "this one has 1"),
        ("name", "sheepdog", "already exists"),
    ],
)
def test_what_is_wrong_is_said_and_nothing_is_made(client, agent, field, value, sentence):
    data = {"name": "new", "algorithm": Algorithm.objects.get(name="DQN").pk, "action_space": "2"}
    data |= {"observation_space": "[[8], -1, 1]", field: value}
    page = client.post(reverse("admin:agents_app_agent_add"), data)
    assert page.status_code == 200
    assert sentence in str(errors(page))
    assert Agent.objects.count() == 1
