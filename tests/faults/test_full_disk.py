"""The disk with all the data is full: steps go on, ends of episodes and log-ins wait, and nothing is lost when there is room."""

from __future__ import annotations

import os
import shutil
import signal
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from shepherd_client import Client, Session, TransientError, Unavailable

from tests.faults.conftest import create_agents
from tests.faults.disks import fill, small_disk
from tests.faults.inside import HERE
from tests.faults.players import playing
from tests.servers import running_server, wait_for


@pytest.fixture
def data() -> Iterator[Path]:
    """A data folder on a disk of its own."""
    folder = Path(tempfile.mkdtemp(prefix="shepherd-"))
    with small_disk(folder, 40):
        yield folder
    shutil.rmtree(folder, ignore_errors=True)


def end_episodes_until_refused(session: Session) -> float:
    """The database goes on for a while in the blocks that it has; the return of the episode whose end is refused."""
    total = 100.0  # of the first, which was begun before
    for _ in range(5000):
        try:
            assert session.step(HERE, 1.0, terminated=True).episode_return == total + 1.0
        except Unavailable:
            return total + 1.0
        session.step(HERE)
        total = 0.0
    raise AssertionError("the disk is not full")


def episode_return(session: Session) -> float | None:
    """Of the episode that ends now; None while its end must be repeated."""
    with suppress(TransientError):
        return session.step(HERE, 1.0, terminated=True).episode_return
    return None


def test_steps_go_on_and_returns_wait_for_room(data: Path) -> None:
    with running_server(data, SHEPHERD_MIN_FREE_MB=1) as server:
        _, key = create_agents(server, {"full": {}})["full"]
        with playing(server, key) as players, Client(key, server.url, patience=5) as client:
            session = client.session()
            session.step(HERE)
            filler = fill(data)
            for _ in range(100):
                assert session.step(HERE, 1.0).action in (0, 1)
            refused = end_episodes_until_refused(session)
            os.kill(server.execution_pids()[0], signal.SIGKILL)
            with suppress(Unavailable):  # what was killed may have left it room enough
                client.session()
            filler.unlink()
            players.play_on()
            assert wait_for(lambda: episode_return(session), what="the end of the episode") == refused
