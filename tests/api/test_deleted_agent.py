"""An agent is deleted while a client steps: the client is told to log in again, and nothing is a fault of Shepherd."""

from __future__ import annotations

from typing import Any

import pytest

from agents_app.models import Agent, APIKey
from envs_app import sessions
from envs_app.transports.base import Claim
from tests.api.conftest import assert_problem


class Deleting:
    """A transport that has no execution, and whose agent is deleted while it is asked for one."""

    def __init__(self, agent: Agent) -> None:
        self.agent = agent

    def acquire(self, claim: Claim, exclude: Any) -> None:
        """None, once the agent is gone."""
        Agent.objects.filter(pk=self.agent.pk).delete()


def test_a_step_that_seeks_an_execution_then_is_told_to_log_in_again(
    api: Any, agent: Agent, monkeypatch: pytest.MonkeyPatch
) -> None:
    key = APIKey.issue(agent)[1]
    monkeypatch.setattr(sessions, "_find_execution", lambda *_, **__: None)
    session_key = api.post("/api/v1/sessions", {}, key).json()["session_key"]
    monkeypatch.undo()
    monkeypatch.setattr(sessions, "get_transport", lambda: Deleting(agent))
    body = {"obs": sessions.handles.get(session_key).observation_space.sample().tolist(), "reward": 0}
    answer = api.post("/api/v1/step", body | {"terminated": False, "truncated": False}, session_key)
    assert_problem(answer, 401, "unknown_session", "deleted")
