"""A restart of the whole server in the middle of an episode: clients repeat a step, and need no new login."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from tests.clients.conformance import VECTOR
from tests.clients.driving import DRIVERS, NEEDS_NODE, Driver
from tests.clients.test_python import TestPython as Python
from tests.servers import running_server

COMMANDS = (Python.command, ["node", str(DRIVERS / "driver.mjs")])


@pytest.fixture
def drivers() -> Iterator[list[Driver]]:
    """A program for each client."""
    with ExitStack() as stack:
        yield [stack.enter_context(Driver(command)) for command in COMMANDS]


@NEEDS_NODE
@pytest.mark.slow
@pytest.mark.timeout(240)  # two starts of a server
def test_clients_play_on_after_a_restart(drivers: list[Driver], data: Path) -> None:
    with running_server(data) as server:
        url, (_, key) = server.url, server.create_agent()
        for drive in drivers:
            drive("login", key=key, url=url, patience=100)
            drive("step", obs=VECTOR)
            drive("step", obs=VECTOR, reward=1.0)
    with ThreadPoolExecutor() as pool:
        steps = [pool.submit(drive, "step", obs=VECTOR, reward=2.0) for drive in drivers]
        with running_server(data, PORT=urlsplit(url).port):
            assert [step.result()["seq"] for step in steps] == [3, 3]
            ends = [drive("step", obs=VECTOR, reward=4.0, terminated=True) for drive in drivers]
            assert [end["episode_return"] for end in ends] == [7.0, 7.0]
