"""The server stops, in order or not, while eight clients step; they wait, and go on in the same sessions."""

from __future__ import annotations

import signal
import time
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from tests.faults.conftest import create_agents
from tests.faults.inside import saves_of
from tests.faults.players import Players, playing, query
from tests.servers import Server, processes_of, running_server

ORDERLY_SECONDS = 25
ABRUPT_SECONDS = 45
KEPT = {"serve.lock", "counters"}  # in run/; the counts of the throttles outlive a restart


def left_in_run(data: Path) -> set[str]:
    """What the processes left in the folder of sockets."""
    return {path.name for path in (data / "run").iterdir()}


def learned(server: Server, agent: str) -> dict[str, int]:
    """The steps in the newest save of each execution."""
    steps: dict[str, int] = {}
    for _, meta in saves_of(server, agent).metas():
        steps.setdefault(meta.execution, meta.steps)
    return steps


@pytest.mark.timeout(300)
def test_clients_play_on_after_sigterm_and_after_kill_9(data: Path) -> None:
    with running_server(data) as first:
        agent, key = create_agents(first, {"stopped": {}})["stopped"]
        address = {"PORT": urlsplit(first.url).port}
        with playing(first, key) as players:
            players.play_on(2)
            end_in_order(first, agent)
            with running_server(data, **address) as second:
                players.play_on(2)
                assert_sessions_are_the_same(second, players)
                kill_all(second)
                with running_server(data, **address) as third:
                    players.play_on(2)
                    assert_sessions_are_the_same(third, players)
                    players.stop()
                    players.check(third)


def end_in_order(server: Server, agent: str) -> None:
    """SIGTERM: soon over, all saved, nothing left."""
    before = time.monotonic()
    assert server.stop() == 0
    assert time.monotonic() - before < ORDERLY_SECONDS
    assert processes_of(server.data) == []
    assert left_in_run(server.data) == KEPT
    executions = query(server, "SELECT uid, end_reason FROM agents_app_execution")
    assert {reason for _, reason in executions} == {"stop"}
    assert {uid.replace("-", "") for uid in learned(server, agent)} == {uid for uid, _ in executions}
    assert query(server, "SELECT COUNT(*) FROM agents_app_save") == [(len(list(saves_of(server, agent).metas())),)]


def kill_all(server: Server) -> None:
    """kill -9 of the supervisor: the rest ends by itself."""
    server.process.send_signal(signal.SIGKILL)
    server.process.wait()
    deadline = time.monotonic() + ABRUPT_SECONDS
    while left := processes_of(server.data):
        assert time.monotonic() < deadline, f"left over: {left}"
        time.sleep(0.1)
    assert left_in_run(server.data) <= KEPT | {"serve.json"}


def assert_sessions_are_the_same(server: Server, players: Players) -> None:
    """No client logged in again."""
    assert query(server, "SELECT COUNT(*) FROM agents_app_session WHERE closed_at IS NULL") == [(len(players),)]
