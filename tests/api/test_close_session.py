"""DELETE /api/v1/session."""

import pytest

from envs_app import errors
from tests.api.conftest import assert_problem


@pytest.fixture
def closed(monkeypatch):
    """The keys of the sessions that were closed."""
    keys = []
    monkeypatch.setattr("envs_app.views.sessions.close_session", keys.append)
    return keys


def test_it_closes_the_session_of_the_key(api, closed):
    response = api.delete("/api/v1/session", "ss_1")
    assert (response.status_code, response.content) == (204, b"")
    assert closed == ["ss_1"]


def test_it_wants_a_session_key(api, closed):
    assert_problem(api.delete("/api/v1/session"), 401, "unknown_session", "Authorization: Bearer <session key>")
    assert closed == []


def test_it_says_when_there_is_no_such_session(api, monkeypatch):
    def unknown(key):
        raise errors.UnknownSession

    monkeypatch.setattr("envs_app.views.sessions.close_session", unknown)
    assert_problem(api.delete("/api/v1/session", "ss_1"), 401, "unknown_session")


def test_other_methods_are_refused(api):
    response = api.post("/api/v1/session", {}, "ss_1")
    assert_problem(response, 405, "method_not_allowed")
    assert response["Allow"] == "DELETE"
