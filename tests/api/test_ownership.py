"""A key reaches its own agent only: every address that there is, asked with every kind of key for what is somebody else's.

The addresses are read from the project, so that a new one is walked as soon as it is there. Those of the admin are walked in
tests/admin/test_ownership.py.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from django.test import Client
from django.urls import URLPattern, URLResolver, get_resolver

from agents_app.models import Agent, APIKey, EpisodeReturn, Run, Save, Session, User, hash_key, make_key
from tests.admin.conftest import with_a_past
from tests.agents.makers import make_agent, make_staff

ARGUMENT = re.compile(r"<(?:\w+:)?(\w+)>|\(\?P<(\w+)>[^)]*\)")
PAGE = "https://a.example"
KINDS = ("manage", "step", "publishable", "session", "none", "staff")
MODELS = (Agent, APIKey, EpisodeReturn, Run, Save, Session, User)


def routes(patterns: list, prefix: str = "") -> Iterator[str]:
    """Every address outside the admin, as it is written."""
    for pattern in patterns:
        route = prefix + str(pattern.pattern)
        if route.startswith("admin"):
            continue
        if isinstance(pattern, URLResolver):
            yield from routes(pattern.url_patterns, route)
        elif isinstance(pattern, URLPattern):
            yield route


def addresses(agent: Agent) -> Iterator[str]:
    """The addresses with everything of the agent that could be named or guessed in them, in the path and in the query."""
    run = agent.current_run()
    numbers = [
        agent.pk,
        run.pk,
        run.number,
        agent.sessions.get().pk,
        agent.api_keys.first().pk,
        agent.owner_id,
        agent.name,
    ]
    for route in routes(get_resolver().url_patterns):
        for number in numbers if ARGUMENT.search(route) else [""]:
            path = "/" + re.sub(r"[\^$?]", "", ARGUMENT.sub(str(number), route))
            yield path
            yield f"{path}?run={run.number}&agent={agent.pk}&id={agent.pk}&owner={agent.owner_id}&session={numbers[3]}"


@pytest.fixture
def foreign(db) -> Agent:
    """An agent of Bob's, with a past; not public."""
    return with_a_past(make_agent("wolfhound", make_staff("bob"), public=False), 123.25)


@pytest.fixture
def callers(db) -> dict[str, tuple[Client, dict[str, str]]]:
    """Ann's browser and programs."""
    mine = make_agent("sheepdog", make_staff("ann"))
    first = APIKey.issue(mine)
    session = make_key("ss")
    Session.objects.create(agent=mine, api_key=first[0], hash=hash_key(session))
    keys = {
        "manage": first[1],
        "step": APIKey.issue(mine, scope=APIKey.Scope.STEP)[1],
        "publishable": APIKey.issue(mine, publishable=True, origins=[PAGE])[1],
        "session": session,
    }
    found = {kind: (Client(), {"Authorization": f"Bearer {key}", "Origin": PAGE}) for kind, key in keys.items()}
    staff = Client()
    staff.force_login(User.objects.get(name="ann"))
    return found | {"none": (Client(), {}), "staff": (staff, {})}


def rows() -> dict[str, list]:
    """What must stay as it is."""
    return {model.__name__: list(model.objects.order_by("pk").values()) for model in MODELS}


def test_there_is_something_to_walk(foreign):
    walked = set(addresses(foreign))
    assert {"/api/v1/agent", "/api/v1/agent/returns", "/api/v1/agent/model", "/shepherd/env/"} <= walked
    assert {f"/agents/{foreign.pk}/", f"/agents/{foreign.pk}/executions.json"} <= walked


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_of_anybody_elses_is_shown(foreign, callers, kind, fleet, settings):
    settings.METRICS_KEY = "for Prometheus alone"
    secrets = (b"wolfhound", b"123.25", b"error of", str(foreign.pk).encode(), foreign.api_keys.get().hash.encode())
    client, headers = callers[kind]
    for address in addresses(foreign):
        response = client.get(address, headers=headers)
        content = b"".join(response.streaming_content) if response.streaming else response.content
        echo = str(foreign.pk).encode()  # some pages repeat what they were asked
        content = content.replace(b"agent=" + echo, b"").replace(b"id=" + echo, b"").replace(address.encode(), b"")
        assert not any(secret in content for secret in secrets), address
        assert response.status_code < 500 or response.status_code == 503, address


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_of_anybody_elses_is_touched(foreign, callers, kind, fleet):
    client, headers = callers[kind]
    body = {"agent": str(foreign.pk), "session": foreign.sessions.get().pk, "id": str(foreign.pk), "public": True}
    before = {name: [row for row in found if "sheepdog" not in str(row)] for name, found in rows().items()}
    for address in addresses(foreign):
        for method in (client.post, client.put, client.patch, client.delete):
            method(address, body, "application/json", headers=headers)
    of_bob = {"agent_id": foreign.pk, "owner_id": foreign.owner_id, "id": foreign.owner_id}
    for name, found in before.items():
        for row in found:
            if any(row.get(key) == value for key, value in of_bob.items()):
                assert row in rows()[name], name
    assert not any(str(foreign.pk) in str(call) or call[0] == "restart" for call in fleet.calls)


def test_what_is_a_number_opens_nothing(foreign, callers, api):
    """Sessions and keys are found by their secrets alone."""
    session, key = foreign.sessions.get(), foreign.api_keys.get()
    for guess in (str(session.pk), session.hash, str(key.pk), key.hash, key.prefix, str(foreign.pk), str(key), ""):
        headers = {"Authorization": f"Bearer {guess}"}
        for address in ("/api/v1/sessions", "/api/v1/step"):
            body = {"obs": [0] * 8, "reward": 0, "terminated": False, "truncated": False}
            assert api.client.post(address, body, "application/json", headers=headers).status_code in (401, 429)
        assert api.client.get("/api/v1/agent", headers=headers).status_code in (401, 429)
        assert api.client.delete("/api/v1/session", headers=headers).status_code == 401
        assert api.post("/shepherd/env/", {"session_key": guess, "obs": [0] * 8}).status_code == 401
        assert api.post("/shepherd/login_user/", {"apikey": guess}).status_code in (401, 429)


def test_each_kind_of_key_opens_its_own_kind_of_door_only(callers):
    step = {"obs": [0] * 8, "reward": 0, "terminated": False, "truncated": False}
    for kind in ("manage", "step", "publishable"):
        client, headers = callers[kind]
        assert client.post("/api/v1/step", step, "application/json", headers=headers).status_code == 401
        assert client.delete("/api/v1/session", headers=headers).status_code == 401
    client, headers = callers["session"]
    assert client.post("/api/v1/sessions", headers=headers).status_code == 401
    assert client.get("/api/v1/agent/returns", headers=headers).status_code == 401
