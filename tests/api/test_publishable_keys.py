"""Publishable keys: they stand in web pages, only step, and only from the origins that their owner named."""

from __future__ import annotations

import json
import time
from typing import Any
from uuid import uuid4

import httpx
import pytest
from django.core.exceptions import ValidationError
from django.db import IntegrityError, transaction
from django.utils import timezone

from agents_app.models import APIKey, Session
from agents_app.origins import read_origin, read_origins
from tests.api.conftest import assert_problem
from tests.servers import Server

PAGE = "https://bored.example"
FOREIGN = "https://evil.example"


@pytest.fixture
def opened(monkeypatch):
    """Sessions are rows that lead nowhere."""

    def open_session(api_key):
        return Session.objects.create(agent=api_key.agent, api_key=api_key, hash=uuid4().hex), "ss_secret"

    monkeypatch.setattr("envs_app.views.sessions.open_session", open_session)
    monkeypatch.setattr("envs_app.views.legacy.open_session", open_session)


@pytest.fixture
def key(agent):
    """For the page, and for those of the server itself."""
    return APIKey.issue(agent, publishable=True, origins=[PAGE])[1]


def test_its_prefix_says_what_it_is_and_its_text_is_kept(agent, key):
    row = APIKey.objects.get()
    assert key.startswith("pk_")
    assert (row.publishable, row.published, row.scope) == (True, key, "step")
    assert APIKey.published_for(agent) == key


def test_no_other_key_is_kept(agent, manage_key, step_key):
    assert set(APIKey.objects.values_list("published", flat=True)) == {""}
    assert APIKey.published_for(agent) is None


def test_a_page_shows_no_key_that_is_revoked_or_expired(agent, key):
    newer = APIKey.issue(agent, publishable=True, expires_at=timezone.now())[1]
    assert newer != key == APIKey.published_for(agent)
    APIKey.objects.update(revoked_at=timezone.now())
    assert APIKey.published_for(agent) is None


def test_it_never_gets_another_scope(agent):
    row, _ = APIKey.issue(agent, scope=APIKey.Scope.MANAGE, publishable=True)
    assert row.scope == "step"
    with pytest.raises(IntegrityError), transaction.atomic():
        APIKey.objects.filter(pk=row.pk).update(scope="manage")


@pytest.mark.parametrize("origin", [PAGE, PAGE.upper(), "http://testserver", "https://testserver"])
def test_its_pages_log_in(api, opened, key, origin):
    assert api.post("/api/v1/sessions", {}, key, Origin=origin).status_code == 201
    assert api.post("/shepherd/login_user/", {"apikey": key}, Origin=origin).json()["ok"] is True


STRANGERS = [
    FOREIGN,
    "null",
    "",
    "https://bored.example:8443",
    "http://bored.example",
    "https://bored.example.evil.example",
]


@pytest.mark.parametrize("origin", [*STRANGERS, "testserver", "://testserver/"])
def test_no_other_page_logs_in(api, opened, key, origin):
    headers = {"Origin": origin} if origin else {}
    assert_problem(
        api.post("/api/v1/sessions", {}, key, **headers), 403, "forbidden", "only in pages of its own origins"
    )
    legacy = api.post("/shepherd/login_user/", {"apikey": key}, **headers)
    assert (legacy.status_code, legacy.json()["ok"]) == (403, False)
    assert not Session.objects.exists()


@pytest.mark.parametrize("path", ["/api/v1/agent", "/api/v1/agent/returns", "/api/v1/agent/model"])
def test_it_reads_nothing(api, key, path):
    response = api.client.get(path, headers={"Authorization": f"Bearer {key}", "Origin": PAGE})
    assert_problem(response, 403, "forbidden", "may only step")


def test_secret_keys_step_from_anywhere(api, opened, step_key):
    assert api.post("/api/v1/sessions", {}, step_key, Origin=FOREIGN).status_code == 201


def test_a_session_steps_only_from_the_pages_of_its_key(server: Server):
    made = json.loads(
        server.make(
            *("create_agent", "--owner=web", "--name=pages", "--algorithm=PPO", "--action-space=2"),
            *("--observation-space=[[4], -10, 10]", f"--origin={PAGE}/"),
        )
    )
    body = {"obs": [0, 0, 0, 0], "reward": 0, "terminated": False, "truncated": False}
    with httpx.Client(base_url=server.url, timeout=60) as http:

        def post(path: str, body: Any, key: str = "", origin: str = PAGE) -> httpx.Response:
            headers = {"Authorization": f"Bearer {key}"} if key else {}
            headers |= {"Origin": origin} if origin else {}
            answer = http.post(path, json=body, headers=headers)
            for _ in range(60):
                if answer.status_code != 503:  # the first execution may take its time
                    break
                time.sleep(1)
                answer = http.post(path, json=body, headers=headers)
            return answer

        key = post("api/v1/sessions", {}, made["publishable_key"]).json()["session_key"]
        old = {"session_key": key, "obs": [0, 0, 0, 0]}
        first = post("api/v1/step", body, key)
        assert first.json().get("action") in (0, 1), first.text
        assert post("api/v1/step", body, key, server.url.rstrip("/")).json()["action"] in (0, 1)
        assert post("shepherd/env/", old).json()["action"] in (0, 1)
        for origin in (FOREIGN, ""):
            refused = post("api/v1/step", body, key, origin)
            assert (refused.status_code, refused.json()["code"]) == (403, "forbidden")
            assert post("shepherd/env/", old, origin=origin).status_code == 403
        assert post("api/v1/step", body, key).json()["seq"] == first.json()["seq"] + 3  # what was refused is no step


@pytest.mark.parametrize(
    ("text", "origin"),
    [
        ("https://Example.org/", "https://example.org"),
        (" http://localhost:5000", "http://localhost:5000"),
        ("https://example.org:443", "https://example.org"),
        ("http://[::1]:80", "http://[::1]"),
    ],
)
def test_origins_are_written_as_browsers_write_them(text, origin):
    assert read_origin(text) == origin


NO_ORIGINS = [
    "",
    "example.org",
    "https://",
    "https://example.org/page",
    "ftp://example.org",
    "https://a@example.org",
    "*",
]
NO_ORIGINS += ["null", "https://*.example.org", "https://example.org:99999", "https://example.org?x", "https://[::1"]


@pytest.mark.parametrize("text", NO_ORIGINS)
def test_what_is_no_origin_is_refused_in_words(text):
    with pytest.raises(ValidationError, match=r"write e.g. https://example.org"):
        read_origin(text)


def test_origins_are_kept_once():
    assert read_origins([PAGE, f"{PAGE}/", FOREIGN]) == [PAGE, FOREIGN]
