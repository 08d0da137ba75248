"""POST /shepherd/login_user/: the original protocol."""

import pytest

from agents_app.models import Session
from envs_app import errors


@pytest.fixture
def opened(monkeypatch):
    """Holds the API keys that sessions were opened with."""
    keys = []

    def open_session(api_key):
        keys.append(api_key)
        return Session(agent=api_key.agent, api_key=api_key), "ss_secret"

    monkeypatch.setattr("envs_app.views.legacy.open_session", open_session)
    return keys


@pytest.mark.parametrize("path", ["/shepherd/login_user/", "/shepherd/login_user"])
def test_it_answers_with_a_session_key(api, opened, step_key, agent, path):
    response = api.post(path, {"apikey": step_key})
    assert (response.status_code, response.json()) == (200, {"ok": True, "session_key": "ss_secret"})
    assert opened[0].agent == agent


@pytest.mark.parametrize("content_type", ["text/plain", "application/x-www-form-urlencoded"])
def test_it_reads_json_whatever_the_content_type(api, opened, step_key, content_type):
    body = b'{"apikey": "%s"}' % step_key.encode()
    assert api.client.post("/shepherd/login_user/", body, content_type).json()["ok"] is True


def test_it_needs_no_csrf_token(api, opened, step_key):
    api.client.handler.enforce_csrf_checks = True
    assert api.post("/shepherd/login_user/", {"apikey": step_key}).json()["ok"] is True


@pytest.mark.django_db
@pytest.mark.parametrize(
    ("body", "status"), [({"apikey": "sk_wrong"}, 401), ({"apikey": 1}, 422), ({}, 422), (b"{", 422)]
)
def test_it_says_what_is_wrong_in_its_own_words(api, opened, body, status):
    response = api.post("/shepherd/login_user/", body)
    assert response.status_code == status
    assert response["Content-Type"] == "application/json"
    assert response.json().keys() == {"ok", "error"}
    assert response.json()["ok"] is False


@pytest.mark.django_db
def test_an_address_with_many_wrong_keys_must_wait(api, opened):
    answers = [api.post("/shepherd/login_user/", {"apikey": "sk_wrong"}) for _ in range(21)]
    assert answers[20].status_code == 429
    assert 1 <= int(answers[20]["Retry-After"]) <= 60


def test_it_says_when_there_is_no_capacity(api, monkeypatch, step_key):
    def full(api_key):
        raise errors.NoCapacity("No execution is free.", 2)

    monkeypatch.setattr("envs_app.views.legacy.open_session", full)
    response = api.post("/shepherd/login_user/", {"apikey": step_key})
    assert (response.status_code, response["Retry-After"]) == (503, "2")
    assert response.json() == {"ok": False, "error": "No execution is free."}


def test_a_get_is_refused_in_its_own_words(api):
    response = api.get("/shepherd/login_user/")
    assert (response.status_code, response.json()["ok"]) == (405, False)


def test_an_unknown_address_is_refused_in_its_own_words(api):
    response = api.get("/shepherd/nothing/")
    assert (response.status_code, response.json()) == (404, {"ok": False, "error": "There is nothing at this address."})
