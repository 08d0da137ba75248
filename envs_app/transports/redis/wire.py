"""Connections to Redis: some commands there in one packet, their replies back."""

from __future__ import annotations

from collections import deque
from threading import Lock
from typing import Any

from redis import ConnectionPool
from redis.connection import ConnectionInterface as Connection
from redis.exceptions import RedisError, ResponseError
from redis.exceptions import TimeoutError as RedisTimeout

from envs_app.transports.base import Away

COMMAND_SECONDS = 3.0  # a command takes microseconds; after so long Redis is away

Command = tuple[Any, ...]


class Unreachable(Away):
    """Redis does not answer, or refuses (out of memory, say). What was sent may have been done, or may be done yet."""


class Wire:
    """Connections that threads share; each serves one thread at a time. Made after a fork, never before.

    While Redis does not answer, one thread at a time tries whether it does again, and the others are told so at once: else all
    threads of a web process would stand and wait, and it could not even say that it lives.
    """

    def __init__(self, url: str) -> None:
        self._factory = ConnectionPool.from_url(
            url, protocol=2, socket_timeout=COMMAND_SECONDS, socket_connect_timeout=COMMAND_SECONDS
        )
        self._idle: deque[Connection] = deque()
        self._silent, self._trial = False, Lock()

    def ask(self, *commands: Command, patience: float = COMMAND_SECONDS) -> list[Any]:
        """The replies. `patience`: seconds for the last one, if it blocks. Raises Unreachable.

        A connection that was idle may be dead: then all is sent once more, so every command must be harmless twice.
        """
        if not self._silent:
            return self._ask(commands, patience)
        if not self._trial.acquire(blocking=False):
            raise Unreachable("Redis does not answer")
        try:
            return self._ask(commands, patience)
        finally:
            self._trial.release()

    def connect(self) -> Connection:
        """A connection of one's own. Raises Unreachable."""
        connection = self._factory.connection_class(
            **self._factory.connection_kwargs
        )  # uncounted, unlike the pool's own
        try:
            connection.connect()
        except (RedisError, OSError) as error:
            raise self._unreachable(error) from error
        return connection

    def close(self) -> None:
        """Close what is idle."""
        while self._idle:
            self._idle.pop().disconnect()

    def _ask(self, commands: tuple[Command, ...], patience: float) -> list[Any]:
        while True:
            try:
                connection, fresh = self._idle.pop(), False
            except IndexError:
                connection, fresh = self.connect(), True
            try:
                replies = self._exchange(connection, commands, patience)
            except (RedisError, OSError) as error:
                connection.disconnect()
                if fresh or isinstance(error, (ResponseError, RedisTimeout)):
                    raise self._unreachable(error) from error
                continue
            self._idle.append(connection)
            return replies

    def _exchange(self, connection: Connection, commands: tuple[Command, ...], patience: float) -> list[Any]:
        connection.send_packed_command(connection.pack_commands(commands), check_health=False)
        replies = []
        for _ in commands[1:]:
            replies.append(connection.read_response())
            self._silent = False  # the last one may take its time
        replies.append(connection.read_response(timeout=patience))
        self._silent = False
        return replies

    def _unreachable(self, error: Exception) -> Unreachable:
        self._silent = isinstance(error, RedisTimeout)
        return Unreachable(f"Redis: {error}")
