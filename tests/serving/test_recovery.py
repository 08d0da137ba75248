"""What is killed is started again, and clients wait for it rather than being refused."""

from __future__ import annotations

import os
import signal
import urllib.request
from collections.abc import Iterator

import pytest

from tests.servers import Server, running_server, wait_for


@pytest.fixture(scope="module")
def own() -> Iterator[Server]:
    """A server to kill parts of."""
    with running_server() as server:
        yield server


def healthy(server: Server) -> bool:
    """Whether a request is answered, at the first attempt."""
    with urllib.request.urlopen(f"{server.url}healthz", timeout=20) as answer:
        return answer.status == 200


def test_requests_wait_for_a_killed_web_process(own: Server) -> None:
    [killed] = own.web_pids()
    os.kill(killed, signal.SIGKILL)
    assert healthy(own)
    assert own.web_pids() != [killed]


def test_requests_wait_for_a_killed_granian(own: Server) -> None:
    killed, worker = own.granian_pid(), own.web_pids()
    assert killed
    os.kill(killed, signal.SIGKILL)
    wait_for(lambda: own.granian_pid() not in (None, killed), what="another granian")
    assert healthy(own)
    wait_for(lambda: not set(worker) & {process.pid for process in own.processes()}, what="the old worker to end")


def test_a_killed_parent_is_started_again(own: Server) -> None:
    killed = own.parent_pid()
    assert killed
    os.kill(killed, signal.SIGKILL)
    wait_for(lambda: own.parent_pid() not in (None, killed), what="another parent")
    own.wait_until_ready()
    assert "executions ended (signal 9) and is started again" in own.printed()


def test_the_supervisor_survives_what_it_restarted(own: Server) -> None:
    assert own.process.poll() is None
    assert own.is_ready()
