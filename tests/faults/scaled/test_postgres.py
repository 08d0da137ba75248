"""PostgreSQL is paused, killed, restarted, and has no connection left: steps go on, ends of episodes wait, nothing is lost."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress

import psycopg
import pytest
from shepherd_client import Client

from tests.faults.inside import HERE
from tests.faults.players import PATIENCE, Players, playing
from tests.faults.scaled.setup import Scaled

pytestmark = [pytest.mark.service, pytest.mark.long]

Agent = Callable[[str], tuple[str, str]]
STEPS = 100  # of an episode, while PostgreSQL is away


@contextmanager
def one_episode(own: Scaled, agent: Agent) -> Iterator[Callable[[float], None]]:
    """A client in the middle of an episode: what is yielded takes steps for so many seconds, each of which must be answered.

    At the end the episode must be whole.
    """
    with Client(agent("other")[1], own.url, patience=PATIENCE) as client:
        session = client.session()
        session.step(HERE)
        session._patience, total = 0.0, 0

        def steps(seconds: float) -> None:
            nonlocal total
            for _ in range(STEPS):
                assert session.step(HERE, 1.0).action in (0, 1)
                total += 1
                time.sleep(seconds / STEPS)

        yield steps
        session._patience = PATIENCE
        assert session.step(HERE, 1.0, terminated=True).episode_return == total + 1


@contextmanager
def no_connection_left(own: Scaled) -> Iterator[None]:
    """Others have all connections that PostgreSQL takes, those of Shepherd too."""
    with ExitStack() as taken:
        first = taken.enter_context(psycopg.connect(own.postgres.url, autocommit=True))
        first.execute("SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE pid <> pg_backend_pid()")
        with suppress(psycopg.OperationalError):
            while True:
                taken.enter_context(psycopg.connect(own.postgres.url))
        yield


def all_at_an_end(players: Players) -> bool:
    """Whether every client waits for the answer to the end of an episode."""
    return all(player.ending.is_set() for player in players)


def test_postgresql_is_paused(own: Scaled, agent: Agent) -> None:
    with playing(own, agent("killed")[1]) as players, one_episode(own, agent) as steps:
        own.postgres.pause()
        try:
            steps(10)
            assert all_at_an_end(players)
        finally:
            own.postgres.resume()
        players.play_on(1)


def test_postgresql_is_killed(own: Scaled, agent: Agent) -> None:
    with playing(own, agent("killed")[1]) as players, one_episode(own, agent) as steps:
        own.postgres.kill()
        steps(4)
        assert all_at_an_end(players)
        own.postgres.start()
        players.play_on(1)


def test_postgresql_has_no_connection_left(own: Scaled, agent: Agent) -> None:
    with playing(own, agent("killed")[1]) as players, one_episode(own, agent) as steps:
        with no_connection_left(own):
            steps(4)
        players.play_on(1)


def test_who_waits_for_an_action_holds_no_connection(own: Scaled, agent: Agent) -> None:
    """A process has two connections; four of its threads wait for executions that hang, and it knew none of their sessions."""
    with playing(own, agent("killed")[1]) as players, Client(agent("other")[1], own.url, patience=0) as client:
        hung = own.execution_pids()
        for pid in hung:
            os.kill(pid, signal.SIGSTOP)
        try:
            for pid in own.web_pids():
                os.kill(pid, signal.SIGKILL)
            own.wait_until_ready()
            session = client.session()
            for _ in range(20):
                session.step(HERE)
                assert session.step(HERE, 1.0, terminated=True).episode_return == 1.0
        finally:
            for pid in hung:
                os.kill(pid, signal.SIGCONT)
        players.play_on(1)
