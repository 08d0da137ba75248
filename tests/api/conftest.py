"""An agent with keys, and a client that speaks JSON."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import pytest
from django.http import HttpResponse
from django.test import Client

from agents_app.fleet import get_fleet
from agents_app.models import Agent, APIKey
from envs_app.requests import Caller
from envs_app.steps import Reply, Step
from tests.agents.makers import RecordingFleet, make_agent


class Api:
    """Django's test client, with bearer keys and JSON bodies."""

    def __init__(self) -> None:
        self.client = Client()

    def get(self, path: str, key: str | None = None, **query: Any) -> Any:
        return self.client.get(path, query, headers=self._headers(key))

    def delete(self, path: str, key: str | None = None) -> Any:
        return self.client.delete(path, headers=self._headers(key))

    def post(self, path: str, body: Any = None, key: str | None = None, **headers: str) -> Any:
        """`body` is sent as JSON, or as it is if it is bytes."""
        data = body if isinstance(body, bytes) else json.dumps(body).encode()
        return self.client.post(path, data, "application/json", headers=self._headers(key) | headers)

    @staticmethod
    def _headers(key: str | None) -> dict[str, str]:
        return {"Authorization": f"Bearer {key}"} if key else {}


def assert_problem(response: HttpResponse, status: int, code: str, words: str = "") -> dict[str, Any]:
    """A whole problem document of RFC 9457; returns it."""
    problem = json.loads(response.content)
    assert response["Content-Type"] == "application/problem+json", problem
    assert (response.status_code, problem["status"], problem["code"]) == (status, status, code), problem
    assert problem["type"] == f"urn:shepherd:problem:{code}"
    assert problem["title"]
    assert words in problem["detail"]
    return problem


@dataclass
class Core:
    """Stands in for envs_app.sessions.step, to test the web layer by itself: remembers, and answers as it is told."""

    answer: Callable[[str, Step], Reply] | Exception = field(default=lambda key, step: Reply(2, step.seq or 1))
    steps: list[tuple[str, Step]] = field(default_factory=list)

    def __call__(self, session_key: str, step: Step, caller: Caller) -> Reply:
        self.steps.append((session_key, step))
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer(session_key, step)


@pytest.fixture
def core(monkeypatch: pytest.MonkeyPatch) -> Core:
    """A step that goes nowhere."""
    core = Core()
    monkeypatch.setattr("envs_app.views.step.step", core)
    return core


@pytest.fixture(autouse=True)
def _one_minute(monkeypatch: pytest.MonkeyPatch) -> None:
    """What throttles count, they count in one span of time, however slow the test is."""
    now = time.time() // 60 * 60 + 1
    monkeypatch.setattr("envs_app.counters.now", lambda: now)


@pytest.fixture
def api() -> Api:
    """The API."""
    return Api()


@pytest.fixture
def agent(db: None) -> Agent:
    """An agent of 8 floats and 4 actions."""
    return make_agent("lander")


@pytest.fixture
def manage_key(agent: Agent) -> str:
    """An API key that may do everything."""
    return APIKey.issue(agent)[1]


@pytest.fixture
def step_key(agent: Agent) -> str:
    """An API key that may only step."""
    return APIKey.issue(agent, scope=APIKey.Scope.STEP)[1]


@pytest.fixture
def fleet(settings: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[type[RecordingFleet]]:
    """A fleet that runs nothing."""
    settings.SHEPHERD_FLEET = "tests.agents.makers.RecordingFleet"
    fresh: dict[str, Any] = {"calls": [], "statuses": [], "zip": None, "unreachable": False}
    for name, value in fresh.items():
        monkeypatch.setattr(RecordingFleet, name, value)
    get_fleet.cache_clear()
    yield RecordingFleet
    get_fleet.cache_clear()
