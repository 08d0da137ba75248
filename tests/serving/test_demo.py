"""`make demo`: a server, a real client that trains, and where to look."""

from __future__ import annotations

import re
import signal
import sqlite3
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from tests.servers import Server, wait_for


@pytest.fixture
def demo(tmp_path: Path) -> Iterator[Server]:
    """A demo of few steps, ended afterwards."""
    data = tmp_path / "data"
    data.mkdir()
    server = Server(data, {"SHEPHERD_LOG": "files"}, command=("demo", "--steps", "300"))
    yield server
    assert server.end() == []


def test_it_trains_says_where_to_look_goes_on_serving_and_ends_with_ctrl_c(demo: Server) -> None:
    printed = wait_for(lambda: "Serving until Ctrl-C" in demo.printed() and demo.printed(), 110, "the demo")
    assert "300/300" in printed
    assert re.search(r"log in +name admin, password \S+ \(shown this once\)", printed)
    assert re.search(r"administration +http://127.0.0.1:\d+/admin/agents_app/agent/[0-9a-f-]{36}/change/", printed)
    assert re.search(r"watch it learn +http://127.0.0.1:\d+/agents/[0-9a-f-]{36}/ ", printed)
    assert [child.cmdline()[-1] for child in psutil.Process(demo.pid).children()] == ["serve"]
    assert demo.stop(signal.SIGINT) == 0
    assert demo.processes() == []
    with sqlite3.connect(demo.data / "shepherd.sqlite3") as database:
        episodes = database.execute("SELECT count(*) FROM agents_app_episodereturn").fetchone()[0]
    assert episodes >= 1
