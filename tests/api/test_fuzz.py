"""Requests that nobody would think of, made from the schema: every answer is one that the schema announces."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import httpx
import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, settings
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from tests.servers import Server

schema = schemathesis.openapi.from_path(Path(__file__).parents[2] / "docs" / "openapi.yaml")
CHECKS = [
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
    status_code_conformance,
]


@pytest.fixture(scope="module")
def keys(server: Server) -> dict[str, str]:
    """The right key for each kind of operation. Few executions, since many sessions are opened, and none for the agent
    that is read from, as a download of the model would wait for each to save. Whole numbers are often observations.
    """
    api_key = server.create_agent(observation_space=100_000, max_executions=2)[1]
    login = httpx.post(f"{server.url}api/v1/sessions", headers={"Authorization": f"Bearer {api_key}"}).json()
    return {"apiKey": api_key, "sessionKey": login["session_key"], "agent": server.create_agent()[1]}


def headers_for(operation: dict[str, Any], keys: dict[str, str]) -> dict[str, str]:
    """The right key, but none to close the session that all steps are sent to."""
    (kind,) = next(iter(operation.get("security", [])), {"none": None})
    key = keys.get("agent" if "agent" in operation["tags"] else kind)
    return {"Authorization": f"Bearer {key}"} if key and operation["operationId"] != "close_session" else {}


@schema.parametrize()
@settings(
    max_examples=15, deadline=None, phases=[Phase.explicit, Phase.generate], suppress_health_check=list(HealthCheck)
)
def test_every_answer_is_one_that_the_schema_announces(case, server, keys):
    headers = headers_for(case.operation.definition.raw, keys)
    response = case.call_and_validate(base_url=server.url.rstrip("/"), headers=headers, checks=CHECKS)
    assert response.status_code != 500


def test_the_server_lives_on_and_logged_no_fault(server, keys):
    assert httpx.get(f"{server.url}readyz").status_code == 200
    assert "Traceback" not in (server.data / "logs" / "web.log").read_text()
