"""`manage.py serve` starts where it is told to, or says in one line why not."""

from __future__ import annotations

import socket
import urllib.request
from pathlib import Path
from typing import Any

import psutil
import pytest

from envs_app.serving import preflight
from tests.servers import Server, running_server, wait_for


def refusal(**environment: Any) -> tuple[str, int]:
    """What a server that cannot start prints, and its exit code."""
    with running_server(ready=False, **environment) as server:
        code = server.process.wait(60)
        return server.printed(), code


def test_it_takes_the_address_and_the_data_folder_of_the_environment(tmp_path: Path) -> None:
    """An IPv6 address, and a folder too deep for the names of Unix sockets."""
    free = preflight.listen("::1", 0)
    port = free.getsockname()[1]
    free.close()
    data = tmp_path / ("deep" * 30)
    with running_server(data=data, HOST="::1", PORT=port) as server:
        assert server.url == f"http://[::1]:{port}/"
        assert {path.name for path in data.iterdir()} >= {"run", "logs", "shepherd.sqlite3", "secrets"}
        assert (data / "shepherd.sqlite3").stat().st_mode & 0o077 == 0
        for path in ("healthz", "static/admin/css/base.css"):
            with urllib.request.urlopen(server.url + path) as answer:
                assert answer.status == 200


def test_it_says_where_it_serves_and_nothing_else(server: Server) -> None:
    last = "Ctrl-C ends it and saves."
    wait_for(lambda: last in server.printed(), what="the last line")  # it serves before it says so
    printed = server.printed().splitlines()
    lines = printed[: printed.index(last) + 1]  # what other tests had it say later is theirs
    assert lines[0] == f"Shepherd is ready: {server.url}"
    assert all(server.url in line for line in lines[:-1])
    assert lines[-1] == last


def test_what_forks_executions_has_one_thread(server: Server) -> None:
    assert psutil.Process(server.parent_pid()).num_threads() == 1


def test_a_taken_port_is_named_and_another_one_advised() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        printed, code = refusal(PORT=port)
    assert f"port {port} on 127.0.0.1 is taken" in printed
    assert f"PORT={port + 1}" in printed
    assert (printed.count("\n"), code) == (1, 1)


def test_a_second_supervisor_of_the_same_data_is_refused(server: Server) -> None:
    before = server.printed()
    second = Server(server.data, {})
    code = second.process.wait(60)
    printed = server.printed().removeprefix(before)
    assert f"already runs with this data (process {server.pid}" in printed
    assert code == 1
    assert server.is_ready()


def test_a_full_disk_is_refused() -> None:
    printed, code = refusal(SHEPHERD_MIN_FREE_MB=10**9)
    assert "the disk is full" in printed
    assert (printed.count("\n"), code) == (1, 1)


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("PORT", "http", "PORT is 'http': write a whole number."),
        ("SHEPHERD_LOG", "syslog", "SHEPHERD_LOG is 'syslog': write one of files, stderr."),
        ("SHEPHERD_WEB_WORKERS", "0", "SHEPHERD_WEB_WORKERS is 0: write 1 or more."),
    ],
)
def test_a_wrong_setting_is_refused_by_its_name(name: str, value: str, said: str) -> None:
    printed, code = refusal(**{name: value})
    assert said in printed
    assert (printed.count("\n"), code) == (1, 1)


def test_a_database_that_cannot_be_reached_is_refused_with_its_reason() -> None:
    printed, code = refusal(DATABASE_URL="postgres://nobody@127.0.0.1:1/nothing")
    assert printed.startswith("CommandError: Shepherd cannot start: manage.py migrate failed")
    assert "refused" in printed
    assert code == 1


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(preflight.StartError, match="cannot be written"):
        preflight.check_disk(tmp_path / "file" / "data", 0)


def test_an_address_of_another_machine_is_refused() -> None:
    with pytest.raises(preflight.StartError, match=r"cannot listen on 192\.0\.2\.1:8000"):
        preflight.listen("192.0.2.1", 8000)
