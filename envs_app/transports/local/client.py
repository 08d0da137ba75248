"""The web process's side of the local transport: pooled Unix connections to the parent and to the executions."""

from __future__ import annotations

import contextlib
import socket
import struct
from collections import defaultdict, deque
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from django.conf import settings

from envs_app.errors import from_code
from envs_app.messages import Message, pack, receive
from envs_app.transports.base import Address, Claim, Transport
from envs_app.transports.local import unix
from envs_app.transports.local.places import Places

PARENT_SECONDS = 10.0


class LocalTransport(Transport):
    """Executions are children of a warmed parent on this machine."""

    def __init__(self, places: Places | None = None) -> None:
        self.places = places or Places(settings.DATA_DIR)
        self._pools: dict[Path, deque[socket.socket]] = defaultdict(deque)

    def acquire(self, claim: Claim, exclude: Iterable[str] = ()) -> Address | None:
        """Ask the parent."""
        reply = self._ask({"k": "acquire", "claim": asdict(claim), "exclude": list(exclude)})
        return None if reply["k"] == "launch" else self._address(reply)

    def launch(self, claim: Claim, spec: dict[str, Any], max_percent_cpu: int, exclude: Iterable[str] = ()) -> Address:
        """Have the parent fork."""
        what = {"claim": asdict(claim), "spec": self.places.locate(spec), "max_percent_cpu": max_percent_cpu}
        return self._address(self._ask({"k": "launch", "exclude": list(exclude), **what}))

    def call(self, address: Address, message: Message, timeout: float) -> Message:
        """One frame there, one back, on a connection of its own."""
        return self._exchange(Path(address.where), message, timeout)

    def forget(self, session: int, agent: str) -> None:
        """Tell the parent."""
        self._ask({"k": "forget", "session": session, "agent": agent})

    def status(self, agent: str | None = None) -> list[dict[str, Any]]:
        """Ask the parent."""
        return self._ask({"k": "status", "agent": agent})["executions"]

    def configure(self, agent: str, settings: dict[str, Any]) -> None:
        """Tell the parent."""
        self._ask({"k": "configure", "agent": agent, "settings": settings})

    def stop(self, agent: str, reason: str) -> int:
        """Tell the parent."""
        return self._ask({"k": "stop", "agent": agent, "reason": reason})["count"]

    def save(self, run: int) -> int:
        """Tell the parent."""
        return self._ask({"k": "save", "run": run})["count"]

    def events(self, after: int) -> list[dict[str, Any]]:
        """Ask the parent."""
        return self._ask({"k": "events", "after": after})["events"]

    def _address(self, reply: Message) -> Address:
        return Address(reply["uid"], str(self.places.execution(reply["uid"])))

    def _ask(self, message: Message) -> Message:
        """Ask the parent; what it refuses is raised."""
        reply = self._exchange(self.places.parent, message, PARENT_SECONDS)
        if reply["k"] == "error":
            raise from_code(reply["code"], reply["detail"], reply["retry_after"])
        return reply

    def _exchange(self, path: Path, message: Message, timeout: float) -> Message:
        """A connection that was idle may be dead: the message is sent once more on a new one, as nobody read it."""
        pool, frame = self._pools[path], pack(message)
        while True:
            try:
                connection, fresh = pool.pop(), False
            except IndexError:
                connection, fresh = self._connect(path, timeout), True
            try:
                connection.sendall(frame)
                reply = receive(connection)
            except BlockingIOError:  # how a late answer shows itself where the kernel keeps the time
                connection.close()
                raise TimeoutError("no answer in time") from None
            except OSError as error:
                connection.close()
                if fresh:
                    raise ConnectionError(f"the execution is gone: {error}") from error
                continue
            pool.append(connection)
            return reply

    def _connect(self, path: Path, timeout: float) -> socket.socket:
        self._close_unused()
        try:
            connection = unix.connect(path, timeout)
            connection.settimeout(None)  # Python's own timeout would poll before each call
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _timeval(timeout))
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _timeval(timeout))
            return connection
        except (BlockingIOError, ConnectionError):
            with contextlib.suppress(KeyError):
                del self._pools[path]
            raise

    def _close_unused(self) -> None:
        """Close the connections to executions that have ended: nobody may ever ask there again."""
        for path in [path for path in list(self._pools) if not path.exists()]:
            with contextlib.suppress(KeyError):
                del self._pools[path]


def _timeval(seconds: float) -> bytes:
    """A `struct timeval`, for the kernel."""
    return struct.pack("ll", int(seconds), int(seconds % 1 * 1_000_000))
