"""Connections to Redis: some commands there in one packet, their replies back."""

from __future__ import annotations

from collections import deque
from typing import Any

from redis import ConnectionPool
from redis.connection import ConnectionInterface as Connection
from redis.exceptions import RedisError, ResponseError
from redis.exceptions import TimeoutError as RedisTimeout

COMMAND_SECONDS = 3.0  # a command takes microseconds; after so long Redis is away

Command = tuple[Any, ...]


class Unreachable(ConnectionError):
    """Redis does not answer, or refuses (out of memory, say). What was sent may have been done, or may be done yet."""


class Wire:
    """Connections that threads share; each serves one thread at a time. Made after a fork, never before."""

    def __init__(self, url: str) -> None:
        self._factory = ConnectionPool.from_url(
            url, protocol=2, socket_timeout=COMMAND_SECONDS, socket_connect_timeout=COMMAND_SECONDS
        )
        self._idle: deque[Connection] = deque()

    def ask(self, *commands: Command, patience: float = COMMAND_SECONDS) -> list[Any]:
        """The replies. `patience`: seconds for the last one, if it blocks. Raises Unreachable.

        A connection that was idle may be dead: then all is sent once more, so every command must be harmless twice.
        """
        while True:
            try:
                connection, fresh = self._idle.pop(), False
            except IndexError:
                connection, fresh = self.connect(), True
            try:
                replies = _exchange(connection, commands, patience)
            except (RedisError, OSError) as error:
                connection.disconnect()
                if fresh or isinstance(error, (ResponseError, RedisTimeout)):
                    raise Unreachable(f"Redis: {error}") from error
                continue
            self._idle.append(connection)
            return replies

    def connect(self) -> Connection:
        """A connection of one's own. Raises Unreachable."""
        connection = self._factory.connection_class(
            **self._factory.connection_kwargs
        )  # uncounted, unlike the pool's own
        try:
            connection.connect()
        except (RedisError, OSError) as error:
            raise Unreachable(f"Redis: {error}") from error
        return connection

    def close(self) -> None:
        """Close what is idle."""
        while self._idle:
            self._idle.pop().disconnect()


def _exchange(connection: Connection, commands: tuple[Command, ...], patience: float) -> list[Any]:
    connection.send_packed_command(connection.pack_commands(commands), check_health=False)
    replies = [connection.read_response() for _ in commands[1:]]
    return [*replies, connection.read_response(timeout=patience)]
