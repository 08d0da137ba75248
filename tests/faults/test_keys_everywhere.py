"""Keys in two web processes: what is revoked in one opens nothing in the other, and throttles count in both."""

from __future__ import annotations

import time
from collections.abc import Callable

import httpx
import pytest
from shepherd_client import Client, InvalidApiKey, Throttled

from tests.faults.test_web_processes import only
from tests.servers import Server

REVOKE = """
from agents_app import services
from agents_app.models import APIKey
services.revoke_key(APIKey.objects.get(agent={agent!r}))
"""


def step(server: Server, process: int, session_key: str) -> int:
    """The status of a step that one web process answers, over a connection of its own."""
    body = {"obs": [0.0] * 4, "reward": 0, "terminated": False, "truncated": False}
    with only(server, process):
        headers = {"Authorization": f"Bearer {session_key}"}
        return httpx.post(f"{server.url}api/v1/step", json=body, headers=headers, timeout=60).status_code


def test_a_revoked_key_opens_nothing_anywhere_within_seconds(
    own: Server, agent: Callable[[str], tuple[str, str]]
) -> None:
    number, key = agent("revoked")
    with Client(key, url=own.url) as client:
        session = client.session()
        session.act([0.0] * 4)  # its execution is there
        assert [step(own, process, session.key) for process in (0, 1)] == [200, 200]  # both know it
        own.manage("shell", "-v", "0", "-c", REVOKE.format(agent=number))  # in a third process, as on another machine
        time.sleep(2.5)  # handles.REFRESH_SECONDS
        assert [step(own, process, session.key) for process in (0, 1)] == [401, 401]
        with pytest.raises(InvalidApiKey):
            client.session()


def test_wrong_keys_are_counted_by_both_together(own: Server) -> None:
    own.wait_until_ready()
    refusals: list[type[Exception]] = []
    for process in (0, 1):
        with only(own, process), Client("sk_wrong", url=own.url, patience=0) as client:
            for _ in range(20):  # each process alone would let 20 pass
                try:
                    client.session()
                except (InvalidApiKey, Throttled) as error:
                    refusals.append(type(error))
    assert Throttled in refusals  # 40 within less than two minutes, of which each allows 20
