"""A sign of life that ends with the process: a connection that listens at a channel where nothing is ever said.

A lease says that an execution lived some seconds ago. When a process is killed, the kernel closes its connections, and Redis
knows at once that nobody listens. A machine without power closes nothing: then the lease must do. docs/adr/0014 says more.
"""

from __future__ import annotations

import logging
import re
import time
from typing import Any

from redis.exceptions import RedisError

from envs_app.transports.redis import keys
from envs_app.transports.redis.wire import Unreachable, Wire

AGAIN_SECONDS = 1.0  # between attempts: a Redis may refuse this for ever (ACLs, a proxy)

log = logging.getLogger("shepherd.execution")


class Vital:
    """The connection of one execution. `server`: the run of Redis in which it was made; another one knows nothing of it."""

    def __init__(self, wire: Wire, uid: str) -> None:
        self._wire, self._channel = wire, keys.alive(uid)
        self._connection: Any = None
        self._tried_at = -AGAIN_SECONDS
        self.server = ""

    def hold(self) -> None:
        """Connect, again where Redis has lost the connection. If that fails, only the lease says that the execution lives."""
        now = time.monotonic()
        if now - self._tried_at < AGAIN_SECONDS:
            return
        self._tried_at = now
        self.let_go()
        try:
            self._connection = self._wire.connect()
            self.server = run_of(self._ask("INFO", "server"))
            self._ask("SUBSCRIBE", self._channel)
        except (Unreachable, RedisError, OSError) as error:
            log.warning("Redis does not watch over an execution, but for its lease: %s", error)
            self.let_go()

    def let_go(self) -> None:
        """Close it."""
        if self._connection is not None:
            self._connection.disconnect()
        self._connection, self.server = None, ""

    def _ask(self, *command: str) -> Any:
        self._connection.send_command(*command)
        return self._connection.read_response()


def run_of(info: bytes) -> str:
    """The name of Redis's run in its INFO; nothing where it has none."""
    found = re.search(rb"run_id:(\w+)", info)
    return found[1].decode() if found else ""
