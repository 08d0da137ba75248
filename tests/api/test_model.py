"""GET /api/v1/agent/model."""

from io import BytesIO

from tests.api.conftest import assert_problem

PATH = "/api/v1/agent/model"


def test_it_sends_the_newest_model_of_the_run(api, agent, manage_key, fleet):
    fleet.zip = BytesIO(b"PK the model")
    response = api.get(PATH, manage_key)
    assert response["Content-Type"] == "application/zip"
    assert response["Content-Disposition"] == 'attachment; filename="lander-run-1.zip"'
    assert b"".join(response.streaming_content) == b"PK the model"
    assert fleet.calls == [("model_zip", agent.current_run())]


def test_it_says_when_nothing_is_saved_yet(api, manage_key, fleet):
    assert_problem(api.get(PATH, manage_key), 404, "not_found", "no save yet")


def test_it_says_when_the_executions_cannot_be_reached(api, manage_key, fleet):
    fleet.unreachable = True
    response = api.get(PATH, manage_key)
    assert_problem(response, 503, "unavailable")
    assert response["Retry-After"] == "1"


def test_it_says_when_there_is_no_such_run(api, manage_key, fleet):
    assert_problem(api.get(PATH, manage_key, run=2), 404, "not_found", "no run 2")


def test_it_wants_the_scope_manage(api, step_key, fleet):
    assert_problem(api.get(PATH, step_key), 403, "forbidden")
    assert fleet.calls == []
