"""Real clients that play while something breaks, and what the database must say afterwards.

Rewards are multiples of a quarter, so that sums are exact, and a client's returns equal the database's or do not.
"""

from __future__ import annotations

import os
import random
import signal
import sqlite3
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

import psycopg
from shepherd_client import Client, Session, TransientError

from agents_app.models import hash_key
from tests.servers import Server, wait_for

PATIENCE = 90.0  # seconds; a client waits for a restart of everything
LENGTHS = range(2, 30)  # of episodes
PAUSE = 0.003  # seconds between steps, so that eight clients leave a small machine some air
CLIENTS = 8


class Player(threading.Thread):
    """One client: plays episodes of random lengths and rewards, and keeps what it was answered."""

    def __init__(self, url: str, key: str, seed: int) -> None:
        super().__init__(daemon=True)
        self.random = random.Random(seed)
        self.episodes: list[tuple[float, int]] = []  # return and length, as answered
        self.repeats = 0  # the most that one step needed
        self.refusals: list[TransientError] = []  # what the client package hid
        self.error: BaseException | None = None
        self.stopping, self.ending = threading.Event(), threading.Event()
        self.session = Client(key, url, patience=PATIENCE).session()
        self.session_key = self.session.key
        self._count_repeats(self.session)

    def run(self) -> None:
        """Play until told to stop; the last episode is truncated."""
        try:
            while not self.stopping.is_set():
                self._episode()
            self.session._connection.close()
        except BaseException as error:
            self.error = error

    def stop(self) -> None:
        """End the episode and wait."""
        self.stopping.set()
        self.join(PATIENCE + 30)
        assert not self.is_alive(), "a client hangs"

    def _episode(self) -> None:
        total, length = 0.0, self.random.choice(LENGTHS)
        self._expect_action(self.session.step(self._observation()))
        for step in range(1, length + 1):
            time.sleep(PAUSE)
            total += (reward := self.random.randint(-8, 8) / 4)
            ends, breaks_off = step == length, self.stopping.is_set()
            if ends or breaks_off:
                self.ending.set()
            reply = self.session.step(self._observation(), reward, terminated=ends, truncated=breaks_off)
            if ends or breaks_off:
                self.ending.clear()
                assert reply.action is None
                assert reply.episode_return == total
                self.episodes.append((total, step))
                return
            self._expect_action(reply)

    def _observation(self) -> list[float]:
        return [self.random.uniform(-1, 1) for _ in range(4)]

    @staticmethod
    def _expect_action(reply: Any) -> None:
        assert reply.action in (0, 1)
        assert reply.episode_return is None

    def _count_repeats(self, session: Session) -> None:
        request, repeats = session._connection.request, 0

        def counted(*arguments: Any) -> Any:
            nonlocal repeats
            try:
                answer = request(*arguments)
            except TransientError as refusal:
                self.refusals.append(refusal)
                repeats += 1
                self.repeats = max(self.repeats, repeats)
                raise
            repeats = 0
            return answer

        session._connection.request = counted  # type: ignore[method-assign]


class Players(list[Player]):
    """All clients of a test."""

    def play_on(self, episodes: int = 3) -> None:
        """Wait until each has ended so many more episodes. Raises what a client raised."""
        goals = [len(player.episodes) + episodes for player in self]
        wait_for(lambda: self._reached(goals), PATIENCE + 30, "the clients to play on")

    def _reached(self, goals: list[int]) -> bool:
        for player in self:
            if player.error is not None:
                raise AssertionError(f"a client failed: {player.error!r}") from player.error
        return all(len(player.episodes) >= goal for player, goal in zip(self, goals, strict=True))

    def beyond(self, goals: list[int]) -> int:
        """How many have ended more episodes than their goal."""
        return sum(len(player.episodes) > goal for player, goal in zip(self, goals, strict=True))

    def refused(self, before: int = 0) -> list[TransientError]:
        """What the clients were refused, and hid; those of each client after so many."""
        return [refusal for player in self for refusal in player.refusals[before:]]

    def stop(self) -> None:
        """Have all end their episodes. Raises what a client raised."""
        for player in self:
            player.stopping.set()
        for player in self:
            player.stop()
        self._reached([0] * len(self))

    def check(self, server: Server) -> None:
        """What was answered is in the database, once, and nothing else is; no client needed another session."""
        for player in self:
            assert returns_of_session(server, player.session_key) == player.episodes
        assert sum(len(player.episodes) for player in self) > 0


@contextmanager
def playing(server: Server, key: str, clients: int = CLIENTS, url: str = "") -> Iterator[Players]:
    """Clients that play during the block, at `url` if it is not the server's own, and are checked after it."""
    players = Players(Player(url or server.url, key, seed) for seed in range(clients))
    for player in players:
        player.start()
    try:
        players.play_on(1)
        yield players
        if not all(player.stopping.is_set() for player in players):
            players.play_on(1)
            players.stop()
            players.check(server)
    finally:
        for player in players:
            player.stopping.set()


@contextmanager
def one_hangs(server: Server, players: Players, episodes: int) -> Iterator[None]:
    """One execution hangs, the clients of all others have ended more than `episodes` since, and it hangs during the block."""
    hung = server.execution_pids()[0]
    os.kill(hung, signal.SIGSTOP)
    try:
        goals = [len(player.episodes) + episodes for player in players]
        wait_for(lambda: players.beyond(goals) >= CLIENTS - 1, 60, "the others")
        yield
    finally:
        os.kill(hung, signal.SIGCONT)


def query(server: Server, sql: str, *parameters: Any) -> list[tuple[Any, ...]]:
    """Rows of the server's database."""
    if url := server.environment.get("DATABASE_URL"):
        with psycopg.connect(url, connect_timeout=30) as remote:
            return remote.execute(sql.replace("?", "%s"), parameters).fetchall()
    address = f"file:{server.data / 'shepherd.sqlite3'}?mode=ro"
    with closing(sqlite3.connect(address, uri=True, timeout=30)) as database:
        return database.execute(sql, parameters).fetchall()


def returns_of_session(server: Server, session_key: str) -> list[tuple[float, int]]:
    """The episodes of a session as the database has them. Fails when a number is missing or double."""
    rows = query(
        server,
        "SELECT value, length, episode FROM agents_app_episodereturn JOIN agents_app_session AS session "
        "ON session.id = session_id WHERE hash = ? ORDER BY episode",
        hash_key(session_key),
    )
    assert [row[2] for row in rows] == list(range(1, len(rows) + 1))
    return [(value, length) for value, length, _ in rows]


def errors_of(server: Server, agent: str) -> list[tuple[str, str]]:
    """Summaries and tracebacks of the agent's errors, oldest first."""
    return query(
        server,
        "SELECT summary, traceback FROM agents_app_executionerror AS error JOIN agents_app_run AS run "
        "ON run.id = run_id WHERE agent_id = ? ORDER BY error.created_at",
        agent.replace("-", ""),
    )


def ends(server: Server, agent: str) -> dict[str, str]:
    """Why each execution of an agent ended, as the administration has it; empty while it lives."""
    return {
        str(uid): reason
        for uid, reason in query(
            server,
            "SELECT uid, end_reason FROM agents_app_execution AS execution JOIN agents_app_run AS run "
            "ON run.id = run_id WHERE agent_id = ?",
            agent,
        )
    }
