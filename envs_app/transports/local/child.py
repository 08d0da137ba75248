"""An execution as a child of the parent: a desk behind Unix sockets."""

from __future__ import annotations

import contextlib
import os
import selectors
import socket
from pathlib import Path
from typing import Any

import numpy as np
import setproctitle
from gymnasium import spaces

from envs_app.execution.ledger import FileLedger
from envs_app.execution.storage import Folder
from envs_app.execution.worker import ExecutionSpec
from envs_app.messages import CHUNK, FrameReader, Message, pack
from envs_app.serving.bond import die_with_parent
from envs_app.transports.local.places import Places
from envs_app.transports.loop import ExecutionLoop, is_step
from envs_app.transports.population import PARENT_GONE

REPLY_SECONDS = 1.0  # a web process reads its replies at once, or loses its connection


class LocalPeers:
    """The policies of the run's other executions, as files that the parent announces."""

    def __init__(self, places: Places, run: int) -> None:
        self._places, self._run = places, run
        self.announced: dict[int, int] = {}
        self.returns: dict[int, float] = {}

    def versions(self) -> dict[int, int]:
        """The live peers that have published."""
        return self.announced

    def mean_returns(self) -> dict[int, float]:
        """Of those that have ended an episode."""
        return self.returns

    def weights(self, number: int) -> np.ndarray | None:
        """The latest weights of a peer."""
        try:
            return np.fromfile(self._places.weights(self._run, number), np.float32)
        except OSError:
            return None


class Child(ExecutionLoop):
    """An execution that listens at a Unix socket, and has another to its parent."""

    peers: LocalPeers

    def __init__(self, spec: ExecutionSpec, places: Places, listener: socket.socket, control: socket.socket) -> None:
        super().__init__(spec, LocalPeers(places, spec.run))
        self.places, self.listener, self.control = places, listener, control
        self.control_frames = FrameReader()
        listener.setblocking(False)

    def open_ways(self) -> None:
        """Web processes, and the parent."""
        self.selector.register(self.listener, selectors.EVENT_READ, self._accept)
        self.selector.register(self.control, selectors.EVENT_READ, self._hear_parent)

    def make_storage(self) -> Folder:
        """The data folder's."""
        return Folder(self.places.saves)

    def make_ledger(self) -> FileLedger:
        """Files."""
        return FileLedger(self.places.ledger, _slot(self.worker.action_space))

    def hang_up(self) -> None:
        """Close the socket, and all connections but the parent's."""
        self.places.execution(self.spec.uid).unlink(missing_ok=True)
        for key in list(self.selector.get_map().values()):
            if key.fileobj not in (self.control, self.wake_reader):
                key.fileobj.close()  # type: ignore[union-attr]

    # --- web processes ---
    def _accept(self, listener: socket.socket) -> None:
        with contextlib.suppress(OSError):  # it may be gone already
            connection, _ = listener.accept()
            connection.settimeout(REPLY_SECONDS)
            reader = FrameReader()
            self.selector.register(connection, selectors.EVENT_READ, lambda sock: self._hear_client(sock, reader))

    def _hear_client(self, connection: socket.socket, reader: FrameReader) -> None:
        try:
            data = connection.recv(CHUNK)
            messages = reader.feed(data)
        except OSError:
            data, messages = b"", []
        if not data or not all(map(is_step, messages)):
            self.selector.unregister(connection)
            connection.close()
            return
        for message in messages:
            self.desk.step(message, connection)

    def answer(self, to: socket.socket, message: Message) -> None:
        """On the connection that the step came by."""
        try:
            to.sendall(pack(message))
        except OSError:  # half of it may have been sent: the event loop closes the connection
            with contextlib.suppress(OSError):
                to.shutdown(socket.SHUT_RDWR)

    # --- the parent ---
    def report(self, message: Message) -> None:
        """Tell the parent; small, and the parent always reads."""
        with contextlib.suppress(OSError):
            self.control.sendall(pack(message))

    def _hear_parent(self, control: socket.socket) -> None:
        try:
            data = control.recv(2**16)
        except OSError:  # killed before it read what it was told
            data = b""
        if not data:
            self.reason = PARENT_GONE
        for message in self.control_frames.feed(data):
            self.obey(message)

    def obey(self, message: Message) -> None:
        """Do what the parent says."""
        if message["k"] == "peers":
            self.peers.announced = {n: v for n, v in message["versions"].items() if n != self.spec.number}
            self.peers.returns = message["returns"]
        else:
            super().obey(message)

    def put_policy(self, weights: np.ndarray) -> None:
        """A file, which the parent announces."""
        path = self.places.weights(self.spec.run, self.spec.number)
        partial = path.with_suffix(".new")
        try:
            weights.tofile(partial)
            partial.rename(path)
        except OSError:
            return  # a full disk: peers keep the policy that they have
        self.report({"k": "published"})


def _slot(action_space: spaces.Space) -> int:
    """Bytes that the state of a session may take: pages enough for its last answer."""
    numbers = int(np.prod(action_space.shape or (1,)))
    return 4096 * (1 + 64 * numbers // 4096)


def main(spec: dict[str, Any], places: Places, listener: socket.socket, control: socket.socket, parent: int) -> int:
    """The life of a forked execution; returns its exit code."""
    die_with_parent(parent)
    setproctitle.setproctitle(f"shepherd: execution {spec['number']} of {spec['agent_id']}")
    os.chdir(Path("/"))
    return Child(ExecutionSpec.from_dict(spec), places, listener, control).run()
