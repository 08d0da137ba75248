"""Owners set what advises an agent, and how."""

import re

import pytest

from agents_app.admin.agents import ADVICE, AgentAdmin, advice_fields
from agents_app.models import Agent
from tests.admin.pages import errors, save, save_as_shown, url
from tests.agents.makers import make_agent


def shown(agent):
    return set(advice_fields(agent)["fields"])


def test_only_the_settings_of_advice_that_mean_anything_are_shown(ann):
    continuous = {"continuous_advice", "advice_samples"}
    vector = make_agent("vector", ann, action_space=[[2], -1, 1])
    averaging = {"averaging"}
    assert shown(make_agent("discrete", ann)) == averaging | set(ADVICE) - continuous
    assert shown(vector) == averaging | set(ADVICE) - {"rho"}
    assert shown(make_agent("off", ann, algorithm="DQN")) == set(ADVICE) - continuous - {"learning_correction"}
    assert shown(make_agent("bdpi", ann, algorithm="BDPI")) == set(ADVICE) - continuous
    assert shown(make_agent("none", ann, algorithm="ARS")) == {"advice_method"}
    assert shown(make_agent("masked", ann, algorithm="MaskablePPO")) == {"averaging", "advice_method"}


def test_each_setting_is_hidden_by_a_condition_on_one_that_is_shown():
    assert set(AgentAdmin.conditional_fields) == set(ADVICE) - {"advice_method"}
    known = {value for choices in (Agent.AdviceMethod, Agent.ContinuousAdvice) for value in choices.values}
    for condition in AgentAdmin.conditional_fields.values():
        assert re.findall("(\\w+) [!=]= ", condition)[0] == "advice_method"
        assert set(re.findall("'(.*?)'", condition)) <= known


def test_another_agent_of_the_owner_may_advise(client, ann, fresh, foreign):
    learned = make_agent("old dog", ann, algorithm="DQN")
    make_agent("other eyes", ann, observation_space=3)
    make_agent("without probabilities", ann, algorithm="ARS")
    field = client.get(url(fresh)).context["adminform"].form.fields["advisor"]
    assert list(field.queryset) == [learned]
    save(client, fresh, advisor=str(learned.pk), advisor_save="best", peers_advise=None)
    fresh.refresh_from_db()
    assert (fresh.advisor, fresh.advisor_save, fresh.peers_advise) == (learned, "best", False)
    for stranger in (foreign, fresh):
        page = save(client, fresh, advisor=str(stranger.pk))
        assert "advisor" in errors(page)
    learned.delete()
    fresh.refresh_from_db()
    assert fresh.advisor is None


def test_an_advisor_stays_whose_spaces_are_written_otherwise(client, ann):
    learned = make_agent("old dog", ann, action_space=[[2], -1.0, 1.0], observation_space={"b": 3, "a": [[2], 0, 1]})
    taught = make_agent("puppy", ann, action_space=[[2], -1, 1], observation_space={"a": [[2], 0, 1], "b": 3})
    taught.advisor = learned
    taught.full_clean()
    taught.save()
    save_as_shown(client, taught, max_executions="7")
    taught.refresh_from_db()
    assert (taught.max_executions, taught.advisor) == (7, learned)


def test_whether_executions_average_is_set_where_they_can(client, ann, fresh):
    assert fresh.averaging
    save(client, fresh, averaging=None)
    fresh.refresh_from_db()
    assert not fresh.averaging
    values = make_agent("values", ann, algorithm="DQN")
    assert not values.averaging
    save(client, values, rho="0.7", learning_correction=None)
    values.refresh_from_db()
    assert (values.rho, values.averaging) == (0.7, False)


def test_an_algorithm_without_advice_says_so(client, ann):
    agent = make_agent("ars", ann, algorithm="ARS")
    assert agent.advice_method == "none"
    assert "ARS takes no advice." in client.get(url(agent)).content.decode()
    page = save(client, agent, advice_method="reuse")
    assert errors(page) == {"advice_method": ["ARS takes no advice: write none, or choose another algorithm."]}


def test_advice_is_set(client, fresh):
    changes = {"advice_method": "reuse", "psi": "0.25", "advisors": "best", "advice_form": "deterministic"}
    save(client, fresh, **changes)
    fresh.refresh_from_db()
    assert (fresh.advice_method, fresh.psi, fresh.advisors, fresh.advice_form) == (
        "reuse",
        0.25,
        "best",
        "deterministic",
    )


@pytest.mark.parametrize(("name", "value"), [("psi", "1.1"), ("rho", "-1"), ("shaping_scale", "-1"), ("psi", "nan")])
def test_shares_and_scales_have_bounds(client, fresh, name, value):
    assert set(errors(save(client, fresh, **{name: value}))) == {name}
