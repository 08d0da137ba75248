"""However the server stops, nothing is left behind, and the next one can start."""

from __future__ import annotations

import signal
import sqlite3

import httpx
import psutil

from envs_app.serving import preflight
from tests.servers import Server, running_server, wait_for


def start_an_execution(server: Server) -> None:
    """Log in and make one step."""
    _, key = server.create_agent()
    step = {"obs": [0, 0, 0, 0], "reward": 0, "terminated": False, "truncated": False}
    with httpx.Client(base_url=server.url, timeout=60) as client:
        login = client.post("api/v1/sessions", headers={"Authorization": f"Bearer {key}"})
        authorization = {"Authorization": f"Bearer {login.json()['session_key']}"}
        assert client.post("api/v1/step", json=step, headers=authorization).status_code == 200


def test_sigterm_ends_everything_in_order_and_writes_down_how_executions_ended() -> None:
    with running_server() as server:
        port = server.state["port"]
        start_an_execution(server)
        assert len(server.execution_pids()) == 1
        assert server.stop(signal.SIGTERM) == 0
        assert server.processes() == []
        assert server.printed().endswith("Shepherd has ended.\n")
        assert not (server.data / "run" / "serve.json").exists()
        preflight.listen("127.0.0.1", port).close()  # the port is free at once
        with sqlite3.connect(server.data / "shepherd.sqlite3") as database:
            ends = database.execute("SELECT ended_at IS NOT NULL, end_reason FROM agents_app_execution").fetchall()
        assert ends == [(1, "stop")]


def test_kill_9_of_the_supervisor_ends_everything_and_the_next_one_waits_for_that() -> None:
    with running_server(SHEPHERD_WEB_WORKERS=2) as first:
        old = first.processes()
        assert len(old) >= 5
        first.process.kill()
        first.process.wait()
        with running_server(data=first.data) as second:
            assert not set(old) & set(second.processes())
            assert not any(process.is_running() for process in old)


def test_a_second_ctrl_c_ends_what_does_not_end_by_itself() -> None:
    with running_server() as server:
        psutil.Process(server.parent_pid()).suspend()  # it does not hear SIGTERM
        server.process.send_signal(signal.SIGINT)
        wait_for(lambda: not server.web_pids(), what="the web to end")
        server.process.send_signal(signal.SIGINT)
        assert server.process.wait(20) == 0
        assert server.processes() == []
        assert "ending at once" in server.printed()
