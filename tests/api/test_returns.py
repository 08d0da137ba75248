"""GET /api/v1/agent/returns."""

import base64
import csv
import io

import pytest

from agents_app.models import APIKey, EpisodeReturn, Execution, Session
from tests.agents.makers import make_agent
from tests.api.conftest import assert_problem

PATH = "/api/v1/agent/returns"


def add_returns(run, values):
    execution, _ = Execution.objects.get_or_create(run=run, number=1)
    key = APIKey.issue(run.agent)[0]
    session = Session.objects.create(agent=run.agent, api_key=key, hash=f"{run.pk}")
    EpisodeReturn.objects.bulk_create(
        EpisodeReturn(run=run, execution=execution, session=session, episode=number, value=value, length=10 + number)
        for number, value in enumerate(values, 1)
    )


@pytest.fixture
def run(agent):
    run = agent.current_run()
    add_returns(run, [1.5, -2.0, 3.25, 4.0, 5.0])
    return run


def test_it_lists_episodes_in_the_order_in_which_they_ended(api, run, manage_key):
    page = api.get(PATH, manage_key).json()
    assert [row["return"] for row in page["results"]] == [1.5, -2.0, 3.25, 4.0, 5.0]
    assert (page["next"], page["previous"]) == (None, None)
    first = page["results"][0]
    assert {key: first[key] for key in ("run", "execution", "episode", "length", "learning")} == {
        **{"run": 1, "execution": 1, "episode": 1, "length": 11, "learning": True},
    }
    assert first["ended_at"].endswith("Z")


def test_it_comes_in_pages_that_link_to_the_next(api, run, manage_key):
    seen, path = [], f"{PATH}?limit=2"
    while path:
        page = api.get(path, manage_key).json()
        assert len(page["results"]) <= 2
        seen += [row["return"] for row in page["results"]]
        path = page["next"]
    assert seen == [1.5, -2.0, 3.25, 4.0, 5.0]


def test_as_csv_it_comes_whole(api, run, manage_key):
    response = api.get(PATH, manage_key, format="csv")
    assert response["Content-Type"] == "text/csv; charset=utf-8"
    assert response["Content-Disposition"] == 'attachment; filename="lander-run-1-returns.csv"'
    assert response.streaming
    rows = list(csv.DictReader(io.StringIO(b"".join(response.streaming_content).decode())))
    assert [float(row["return"]) for row in rows] == [1.5, -2.0, 3.25, 4.0, 5.0]
    assert {row["run"] for row in rows} == {"1"}


def test_it_shows_the_run_that_learns_now_or_the_one_that_is_asked_for(api, run, agent, manage_key):
    add_returns(agent.runs.create(number=2), [7.0])
    assert [row["return"] for row in api.get(PATH, manage_key).json()["results"]] == [7.0]
    assert len(api.get(PATH, manage_key, run=1).json()["results"]) == 5


def test_it_shows_nothing_of_other_agents(api, run, manage_key):
    other = APIKey.issue(make_agent("other"))[1]
    assert api.get(PATH, other).json()["results"] == []
    assert len(list(api.get(PATH, other, format="csv").streaming_content)) == 1


@pytest.mark.parametrize("query", [{"run": "x"}, {"run": "-1"}, {"run": "²"}, {"run": "9" * 30}, {"format": "xml"}])
def test_it_refuses_a_query_that_it_does_not_understand(api, run, manage_key, query):
    assert_problem(api.get(PATH, manage_key, **query), 422, "invalid_request", next(iter(query)))


@pytest.mark.parametrize("cursor", ["x", "p=abc", "p=1&o=-1", "p=1e3", "o=x", "p=" + "9" * 30, "p=\0", "\udcff"])
def test_a_cursor_that_it_did_not_make_does_no_harm(api, run, manage_key, cursor):
    encoded = base64.b64encode(cursor.encode(errors="surrogateescape")).decode()
    for sent in (cursor.encode(errors="replace"), encoded):
        response = api.get(PATH, manage_key, cursor=sent)
        if response.status_code != 200:
            assert_problem(response, 404, "not_found", "cursor")


def test_it_says_when_there_is_no_such_run(api, run, manage_key):
    assert_problem(api.get(PATH, manage_key, run=7), 404, "not_found", "no run 7")


def test_a_host_name_that_is_not_allowed_is_refused(api, run, manage_key, settings):
    settings.ALLOWED_HOSTS = ["shepherd.example"]
    headers = {"Authorization": f"Bearer {manage_key}", "Host": "evil.example"}
    assert_problem(api.client.get(f"{PATH}?limit=2", headers=headers), 422, "invalid_request", "evil.example")


def test_it_wants_the_scope_manage(api, run, step_key):
    assert_problem(api.get(PATH, step_key), 403, "forbidden")


def test_a_page_takes_few_queries(api, run, manage_key, django_assert_max_num_queries):
    api.get(PATH, manage_key)
    with django_assert_max_num_queries(4):
        api.get(PATH, manage_key)
