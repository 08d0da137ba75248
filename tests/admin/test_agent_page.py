"""What the page of an agent shows, and gives to download."""

import csv
import io

from agents_app.models import Agent
from tests.admin.pages import url
from tests.agents.makers import make_agent


def test_returns_are_downloaded_as_csv(client, agent):
    response = client.get(url(agent, "csv_view"))
    rows = list(csv.DictReader(io.StringIO(b"".join(response.streaming_content).decode())))
    assert response["Content-Disposition"] == 'attachment; filename="sheepdog-run-1.csv"'
    assert [(row["run"], row["execution"], row["return"], row["length"]) for row in rows] == [("1", "1", "7.5", "10")]


def test_the_model_is_downloaded_as_it_is(client, agent, fleet):
    content = b"PK the model"
    fleet.zip = io.BytesIO(content)
    response = client.get(url(agent, "model_view"))
    assert b"".join(response.streaming_content) == content
    assert response["Content-Disposition"] == 'attachment; filename="sheepdog-run-1.zip"'


def test_that_there_is_no_model_yet_is_said(client, agent):
    assert b"There is no model yet" in client.get(url(agent, "model_view"), follow=True).content


def test_executions_and_errors_are_live(client, agent, fleet):
    fleet.statuses = [{"number": 1, "state": "acting", "steps": 5, "advisors": [2]}]
    live = client.get(url(agent, "live_view")).json()
    assert live["executions"] == fleet.statuses
    assert (live["errors"][0]["summary"], live["errors"][0]["traceback"]) == ("error of sheepdog", "trace of sheepdog")
    fleet.unreachable = True
    assert "cannot be reached" in client.get(url(agent, "live_view")).json()["notice"]


def test_a_reader_who_has_the_whole_curve_gets_nothing(client, agent):
    curve = client.get(url(agent, "curve_view")).json()
    assert curve["lines"][0]["value"] == [7.5]
    assert client.get(url(agent, "curve_view"), {"version": curve["version"]}).json() == {"unchanged": True}


def test_the_page_counts_no_returns(client, agent, django_assert_max_num_queries):
    client.get(url(agent))
    with django_assert_max_num_queries(25) as captured:
        client.get(url(agent))
    assert not any("episodereturn" in query["sql"] for query in captured.captured_queries)


def test_a_second_agent_with_the_same_name_belongs_to_another_owner(client, agent):
    make_agent("sheepdog", "carla")
    assert Agent.objects.filter(name="sheepdog").count() == 2
