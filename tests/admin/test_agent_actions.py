"""Owners have an agent evaluated, restarted, reset and deleted."""

import pytest
from django.test import Client

from agents_app.models import Agent, EpisodeReturn
from tests.admin.pages import act, url


def test_evaluating_stops_the_learning_and_learning_goes_on(client, agent, fleet):
    assert b"learns nothing" in act(client, agent, "evaluate").content
    agent.refresh_from_db()
    assert not agent.enable_learning
    act(client, agent, "learn")
    assert [call[2] for call in fleet.calls if call[0] == "set_learning"] == [False, True]


def test_restarting_ends_the_executions(client, agent, fleet):
    assert b"2 executions saved and ended" in act(client, agent, "restart").content
    assert ("restart", str(agent.pk)) in fleet.calls


def test_resetting_begins_the_next_run_and_keeps_the_old_one(client, agent, fleet):
    act(client, agent, "reset")
    assert list(agent.runs.values_list("number", "ended_at")[1:]) == [(2, None)]
    assert agent.runs.get(number=1).ended_at
    assert agent.runs.get(number=1).returns.count() == 1
    assert ("restart", str(agent.pk)) in fleet.calls
    assert client.get(url(agent, "curve_view")).json()["lines"][0]["x"] == []
    assert client.get(url(agent, "curve_view") + "?run=1").json()["lines"][0]["value"] == [7.5]


def test_deleting_saves_and_curve_is_for_the_chosen_run(client, agent, fleet):
    act(client, agent, "reset")
    first = agent.runs.get(number=1)
    client.post(url(agent, "action_view", "delete_saves") + "?run=1")
    client.post(url(agent, "action_view", "delete_curve"))
    assert ("delete_saves", first) in fleet.calls
    assert EpisodeReturn.objects.count() == 1
    client.post(url(agent, "action_view", "delete_curve") + "?run=1")
    assert EpisodeReturn.objects.count() == 0


@pytest.mark.parametrize("name", ["reset", "delete_saves", "delete_curve"])
def test_what_destroys_asks_first(client, agent, fleet, name):
    page = client.get(url(agent, "action_view", name))
    assert b"No, go back" in page.content
    assert agent.runs.count() == EpisodeReturn.objects.count() == 1
    assert fleet.calls == []


@pytest.mark.parametrize("name", ["evaluate", "learn", "restart"])
def test_nothing_is_done_by_get(client, agent, fleet, name):
    assert client.get(url(agent, "action_view", name)).status_code == 405
    assert client.get(url(agent, "make_key_view")).status_code == 405
    assert fleet.calls == []


def test_nothing_is_done_without_a_csrf_token(ann, agent, fleet):
    browser = Client(enforce_csrf_checks=True)
    browser.force_login(ann)
    key = agent.api_keys.get()
    for name in ("restart", "reset", "evaluate", "delete_curve"):
        assert browser.post(url(agent, "action_view", name)).status_code == 403
    assert browser.post(url(agent, "make_key_view")).status_code == 403
    assert browser.post(url(agent, "revoke_key_view", key.pk)).status_code == 403
    assert fleet.calls == []


@pytest.mark.parametrize("name", ["restart", "delete_saves", "evaluate"])
def test_an_unreachable_fleet_is_said(client, agent, fleet, name):
    fleet.unreachable = True
    assert b"cannot be reached" in act(client, agent, name).content


def test_unknown_actions_and_runs_are_not_found(client, agent):
    assert client.post(url(agent, "action_view", "explode")).status_code == 404
    for number in ("7", "x", "-1", "²"):
        assert client.get(url(agent, "curve_view") + f"?run={number}").status_code == 404


def test_a_deleted_agent_takes_everything_along(client, agent, fleet):
    assert b"sheepdog, with everything" in client.get(url(agent, "delete")).content
    client.post(url(agent, "delete"), {"post": "yes"})
    assert not Agent.objects.exists()
    assert [call[0] for call in fleet.calls] == ["restart", "delete_saves"]


def test_an_agent_whose_executions_cannot_be_ended_stays(client, agent, fleet):
    fleet.unreachable = True
    page = client.post(url(agent, "delete"), {"post": "yes"}, follow=True)
    assert b"Not deleted" in page.content
    assert Agent.objects.exists()
