"""Somebody holds the database for five seconds: steps go on, episodes end later, nothing is lost."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager

from shepherd_client import Client

from tests.faults.inside import HERE
from tests.faults.players import Players, playing, query
from tests.servers import Server, wait_for

Agent = Callable[[str], tuple[str, str]]
LOCKED_SECONDS = 5.0


@contextmanager
def locked(server: Server) -> Iterator[None]:
    """Another connection holds the database for itself, for LOCKED_SECONDS at least."""
    with closing(sqlite3.connect(server.data / "shepherd.sqlite3", isolation_level=None, timeout=30)) as other:
        other.execute("BEGIN EXCLUSIVE")
        until = time.monotonic() + LOCKED_SECONDS
        yield
        time.sleep(max(0.0, until - time.monotonic()))
        other.execute("ROLLBACK")


def recorded(server: Server) -> int:
    """How many returns the database has."""
    [(count,)] = query(server, "SELECT COUNT(*) FROM agents_app_episodereturn")
    return count


def all_at_an_end(players: Players) -> bool:
    """Whether every client waits for the answer to the end of an episode."""
    return all(player.ending.is_set() for player in players)


def test_steps_go_on_and_ends_of_episodes_wait(own: Server, agent: Agent) -> None:
    with playing(own, agent("killed")[1]) as players, Client(agent("other")[1], own.url) as client:
        session = client.session()
        session.step(HERE)
        with locked(own):
            before = recorded(own)
            for _ in range(200):
                assert session.step(HERE, 1.0).action in (0, 1)
            wait_for(lambda: all_at_an_end(players), LOCKED_SECONDS + 15, "all clients to wait for an end")
            assert recorded(own) == before
        players.play_on()
        assert session.step(HERE, 1.0, terminated=True).episode_return == 201.0
