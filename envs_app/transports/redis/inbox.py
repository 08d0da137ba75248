"""The list by which an execution gets steps and control messages: it blocks there, and comes back when Redis was away."""

from __future__ import annotations

import logging
import selectors
import time
from collections.abc import Callable
from typing import Any

from redis.exceptions import RedisError

from envs_app.messages import Message, unpack
from envs_app.transports.loop import STATUS_SECONDS
from envs_app.transports.redis import keys
from envs_app.transports.redis.wire import Unreachable, Wire

AT_ONCE = 32  # messages taken together
LISTEN_SECONDS = 20.0  # then it listens anew: a connection may be dead and not know it
AGAIN_SECONDS = 0.2  # between attempts to reach Redis

log = logging.getLogger("shepherd.execution")


class Inbox:
    """Of one execution. `serve` gets each message, out of the selector's loop."""

    def __init__(
        self, wire: Wire, uid: str, selector: selectors.BaseSelector, serve: Callable[[Message], None]
    ) -> None:
        self._wire, self._uid, self._selector, self._serve = wire, uid, selector, serve
        self._connection: Any = None
        self._socket: Any = None
        self._listened_at = self._tried_at = 0.0

    @property
    def nap(self) -> float:
        """For how long its loop may sleep at most."""
        return STATUS_SECONDS if self._connection is not None else AGAIN_SECONDS

    def tend(self) -> bool:
        """Listen again where the connection is gone, or has been silent for too long; whether it does so since now."""
        now = time.monotonic()
        if self._connection is not None and now - self._listened_at > LISTEN_SECONDS + 2 * STATUS_SECONDS:
            self.close()
        if self._connection is not None or now - self._tried_at <= AGAIN_SECONDS:
            return False
        self.open()
        return self._connection is not None

    def open(self) -> None:
        """Listen, if Redis can be reached."""
        self._tried_at = time.monotonic()
        try:
            self._connection = self._wire.connect()
            self._ask_for_more()
        except (Unreachable, RedisError) as error:
            log.warning("execution %s does not reach Redis: %s", self._uid, error)
            self.close()
        else:
            self._socket = self._connection._sock  # redis-py offers no other way to wait for it beside something else
            self._selector.register(self._socket, selectors.EVENT_READ, self._hear)

    def close(self) -> None:
        """Listen no more."""
        if self._socket is not None:
            self._selector.unregister(self._socket)
        if self._connection is not None:
            self._connection.disconnect()
        self._connection = self._socket = None

    def _ask_for_more(self) -> None:
        self._listened_at = time.monotonic()
        self._connection.send_command("BLMPOP", LISTEN_SECONDS, 1, keys.inbox(self._uid), "LEFT", "COUNT", AT_ONCE)

    def _hear(self, _: Any) -> None:
        found = None
        try:
            found = self._connection.read_response()
            self._ask_for_more()  # before the messages are served, so that nobody waits for them
        except (RedisError, OSError):
            self.close()
        for raw in found[1] if found else ():
            self._serve(unpack(raw))
