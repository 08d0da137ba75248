"""POST /api/v1/sessions."""

from datetime import timedelta

import pytest
from django.utils import timezone

from agents_app.models import APIKey, Session
from envs_app import errors
from tests.api.conftest import assert_problem


@pytest.fixture
def opened(monkeypatch):
    """Sessions are rows that lead nowhere; holds the API keys that they were opened with."""
    keys = []

    def open_session(api_key):
        keys.append(api_key)
        return Session.objects.create(agent=api_key.agent, api_key=api_key, hash=str(len(keys))), "ss_secret"

    monkeypatch.setattr("envs_app.views.sessions.open_session", open_session)
    return keys


def post(api, key, body=b""):
    return api.post("/api/v1/sessions", body, key=key)


def test_it_answers_with_a_session_key_and_what_the_client_must_know(api, opened, manage_key):
    response = post(api, manage_key)
    assert response.status_code == 201
    assert response.json() == {
        "session_key": "ss_secret",
        "agent": {
            "name": "lander",
            "algorithm": "PPO",
            "action_space": 4,
            "observation_space": [[8], -10, 10],
            "action_masks": False,
        },
    }


def test_a_key_that_may_only_step_is_enough(api, opened, step_key, agent):
    assert post(api, step_key, {}).status_code == 201
    assert opened[0].agent == agent


@pytest.mark.django_db
@pytest.mark.parametrize("key", [None, "", "sk_wrong", "ä", "sk_" + "x" * 10_000])
def test_it_rejects_a_wrong_key(api, opened, key):
    response = post(api, key)
    assert_problem(response, 401, "invalid_api_key", "Authorization: Bearer <API key>")
    assert response["WWW-Authenticate"] == 'Bearer realm="Shepherd"'
    assert opened == []


def test_it_rejects_a_revoked_key(api, opened, manage_key):
    APIKey.objects.update(revoked_at=timezone.now())
    assert_problem(post(api, manage_key), 401, "invalid_api_key")


def test_it_rejects_an_expired_key(api, opened, manage_key):
    APIKey.objects.update(expires_at=timezone.now() - timedelta(seconds=1))
    assert_problem(post(api, manage_key), 401, "invalid_api_key")
    APIKey.objects.update(expires_at=timezone.now() + timedelta(days=1))
    assert post(api, manage_key).status_code == 201


def test_it_rejects_the_key_of_an_owner_who_is_not_active(api, opened, manage_key, agent):
    agent.owner.is_active = False
    agent.owner.save()
    assert_problem(post(api, manage_key), 401, "invalid_api_key")


@pytest.mark.parametrize("body", [{"name": "x"}, [], b"{", b"x"])
def test_it_refuses_a_body(api, opened, manage_key, body):
    assert_problem(post(api, manage_key, body), 422, "invalid_request")
    assert opened == []


def test_it_says_when_there_is_no_capacity(api, monkeypatch, manage_key):
    def full(api_key):
        raise errors.NoCapacity("Wait.", 3.5)

    monkeypatch.setattr("envs_app.views.sessions.open_session", full)
    response = post(api, manage_key)
    assert_problem(response, 503, "no_capacity", "Wait.")
    assert response["Retry-After"] == "4"


def test_it_notes_when_the_key_was_used_about_once_a_minute(api, opened, manage_key):
    post(api, manage_key)
    first = APIKey.objects.get().last_used_at
    assert timezone.now() - first < timedelta(seconds=10)
    post(api, manage_key)
    assert APIKey.objects.get().last_used_at == first
    APIKey.objects.update(last_used_at=first - timedelta(minutes=2))
    post(api, manage_key)
    assert APIKey.objects.get().last_used_at > first


@pytest.mark.django_db
def test_an_address_with_many_wrong_keys_must_wait(api, opened):
    answers = [post(api, f"sk_{number}") for number in range(21)]
    assert {answer.status_code for answer in answers[:20]} == {401}
    problem = assert_problem(answers[20], 429, "throttled", "Too many wrong API keys")
    assert 0 < problem["retry_after"] <= 60
    assert int(answers[20]["Retry-After"]) >= problem["retry_after"]


def test_a_right_key_is_let_through_from_an_address_that_must_wait(api, opened, manage_key):
    for number in range(30):
        post(api, f"sk_{number}")
    assert post(api, manage_key).status_code == 201


@pytest.mark.django_db
def test_behind_a_proxy_that_ends_tls_each_client_is_counted_by_itself(api, opened, settings):
    settings.BEHIND_TLS = True
    for _number in range(30):
        api.post("/api/v1/sessions", b"", **{"X-Forwarded-For": "10.0.0.9, 203.0.113.1"})
    other = api.post("/api/v1/sessions", b"", **{"X-Forwarded-For": "203.0.113.1, 203.0.113.2"})
    assert_problem(other, 401, "invalid_api_key")


def test_other_methods_are_refused(api, db):
    assert_problem(api.get("/api/v1/sessions", "sk_wrong"), 401, "invalid_api_key")
    assert_problem(api.client.put("/api/v1/session"), 405, "method_not_allowed")
