"""An execution as a child of the parent: a desk behind Unix sockets. One thread acts, one learns."""

from __future__ import annotations

import contextlib
import logging
import os
import selectors
import signal
import socket
import sys
import time
import traceback
from pathlib import Path
from typing import Any

import numpy as np
import setproctitle
from gymnasium import spaces

from envs_app.execution.desk import Desk
from envs_app.execution.ledger import FileLedger
from envs_app.execution.worker import ExecutionSpec, Worker
from envs_app.messages import CHUNK, FrameReader, Message, pack
from envs_app.serving.bond import die_with_parent
from envs_app.transports.local.places import Places

STATUS_SECONDS = 1.0
HEARTBEAT_SECONDS = 5.0  # so often it says at least that it lives
REPLY_SECONDS = 1.0  # a web process reads its replies at once, or loses its connection
STEP_KEYS = {"session", "request", "seq", "claim", "obs", "reward", "terminated", "truncated", "mask"}
STOP_SECONDS = 12.0  # for the learner's last save; the parent kills a little later
PUBLISH_SECONDS = 0.05  # A2C would publish a hundred times a second
SWITCH_SECONDS = (
    0.0005  # a learner in Python code gives way to the actor after so long; 10 times finer than the default
)

log = logging.getLogger("shepherd.execution")


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


class Child:
    """The event loop of an execution."""

    def __init__(self, spec: ExecutionSpec, places: Places, listener: socket.socket, control: socket.socket) -> None:
        self.spec, self.places, self.listener, self.control = spec, places, listener, control
        self.selector = selectors.DefaultSelector()
        self.wake_reader, self.wake_writer = socket.socketpair()
        for quiet in (listener, self.wake_reader, self.wake_writer):
            quiet.setblocking(False)
        self.control_frames = FrameReader()
        self.peers = LocalPeers(places, spec.run)
        self.reason = ""  # set: the execution ends
        self.reported_at = self.published_at = self.said_at = 0.0
        self.reported: dict[str, Any] = {}

    def run(self) -> int:
        """Serve until told to stop; returns the exit code."""
        signal.set_wakeup_fd(self.wake_writer.fileno(), warn_on_full_buffer=False)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_signal if number == signal.SIGTERM else signal.SIG_IGN)
        try:
            self._open()
            while not self.reason:
                self._turn()
            return self._close()
        except LearnerFailed as failure:
            self._report_failure(str(failure))
        except BaseException:
            self._report_failure(traceback.format_exc())
        return 1

    def _open(self) -> None:
        self.worker = Worker(self.spec, self.peers, self._publish, self.wake, self.report)
        self.desk = Desk(
            self.worker, FileLedger(self.places.ledger, _slot(self.worker.action_space)), send, self.report
        )
        self.selector.register(self.listener, selectors.EVENT_READ, self._accept)
        self.selector.register(self.control, selectors.EVENT_READ, self._hear_parent)
        self.selector.register(self.wake_reader, selectors.EVENT_READ, self._woken)
        self.report({"k": "ready"})

    def _turn(self) -> None:
        due = self.desk.next_due()
        for key, _ in self.selector.select(STATUS_SECONDS if due is None else min(due, STATUS_SECONDS)):
            key.data(key.fileobj)
        if due is not None:
            self.desk.wake()
        if self.worker.failure:
            self.desk.abandon()
            raise LearnerFailed(self.worker.failure)
        if time.monotonic() - self.reported_at >= STATUS_SECONDS:
            self.desk.end_unanswered()
            self._report_status()

    def _close(self) -> int:
        self.desk.abandon()
        self._hang_up()
        self._report_status()
        if not self.worker.stop(STOP_SECONDS):
            self._report_failure(f"the learner did not end in {STOP_SECONDS} s: what it learned last is not saved")
        if self.worker.failure:
            self._report_failure(self.worker.failure)
        self.report({"k": "ended", "reason": self.reason})
        return 0

    def _hang_up(self) -> None:
        """Serve nobody any more: whoever asks is sent elsewhere at once, not when the learner has saved."""
        self.places.execution(self.spec.uid).unlink(missing_ok=True)
        for key in list(self.selector.get_map().values()):
            if key.fileobj not in (self.control, self.wake_reader):
                key.fileobj.close()  # type: ignore[union-attr]

    # --- sockets ---
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
        if not data or not all(message.keys() >= STEP_KEYS for message in messages):
            self.selector.unregister(connection)
            connection.close()
            return
        for message in messages:
            self.desk.step(message, connection)

    def _woken(self, reader: socket.socket) -> None:
        with contextlib.suppress(BlockingIOError):
            reader.recv(4096)
        self.desk.wake()

    def wake(self) -> None:
        """From the learner's thread: parked steps may go on. Costs nothing when there are none."""
        if self.desk_has_parked():
            with contextlib.suppress(BlockingIOError):
                self.wake_writer.send(b"w")

    def desk_has_parked(self) -> bool:
        """Whether anybody waits for the learner, or it has something to say."""
        return not hasattr(self, "desk") or bool(self.desk.parked) or self.worker.failure is not None

    # --- the parent ---
    def report(self, message: Message) -> None:
        """Tell the parent; from either thread. Small, and the parent always reads."""
        with contextlib.suppress(OSError):
            self.control.sendall(pack(message))

    def _hear_parent(self, control: socket.socket) -> None:
        try:
            data = control.recv(2**16)
        except OSError:  # killed before it read what it was told
            data = b""
        if not data:
            self.reason = "parent gone"
        for message in self.control_frames.feed(data):
            self._obey(message)

    def _obey(self, message: Message) -> None:
        match message["k"]:
            case "stop":
                self.reason = message["reason"]
            case "peers":
                self.peers.announced = {n: v for n, v in message["versions"].items() if n != self.spec.number}
                self.peers.returns = message["returns"]
            case "crowded":
                self.desk.crowded_until = time.monotonic() + message["seconds"]
            case "throttle":
                self.desk.throttled_until = time.monotonic() + message["seconds"]
            case "configure":
                self._configure(message)
            case "save":
                self.worker.save_now(message["ticket"])
            case "forget":
                self.desk.release(message["session"])

    def _configure(self, message: Message) -> None:
        self.worker.set_learning(message.get("learning", self.worker.learning))
        self.desk.set_sessions(message.get("sessions", self.spec.sessions))
        self.worker.learner.save_interval = message.get("save_interval", self.worker.learner.save_interval)
        self.desk.wake()

    def _report_status(self) -> None:
        self.reported_at = time.monotonic()
        status = self.worker.status() | self.desk.status()
        if status != self.reported or self.reported_at - self.said_at >= HEARTBEAT_SECONDS:
            self.reported, self.said_at = status, self.reported_at
            self.report({"k": "status", "status": status, "idle": time.monotonic() - self.desk.used_at})

    def _report_failure(self, text: str) -> None:
        log.error("execution %s of agent %s failed:\n%s", self.spec.number, self.spec.agent_id, text)
        self.report({"k": "error", "summary": _summary(text), "traceback": text, "fatal": True})

    def _publish(self, weights: np.ndarray) -> None:
        """In the learner's thread: put the policy where peers find it, then have the parent announce it."""
        if time.monotonic() - self.published_at < PUBLISH_SECONDS:
            return
        self.published_at = time.monotonic()
        path = self.places.weights(self.spec.run, self.spec.number)
        partial = path.with_suffix(".new")
        try:
            weights.tofile(partial)
            partial.rename(path)
        except OSError:
            return  # a full disk: peers keep the policy that they have
        self.report({"k": "published"})

    def _on_signal(self, number: int, frame: Any) -> None:
        self.reason = self.reason or "stop"


def _slot(action_space: spaces.Space) -> int:
    """Bytes that the state of a session may take: pages enough for its last answer."""
    numbers = int(np.prod(action_space.shape or (1,)))
    return 4096 * (1 + 64 * numbers // 4096)


def _summary(text: str) -> str:
    """The line of a traceback that names the error, or the first line of another text."""
    lines = text.splitlines()
    after = max((number for number, line in enumerate(lines) if line.startswith('  File "')), default=-1)
    return next((line for line in lines[after + 1 :] if line[:1].strip()), "failed")


class LearnerFailed(RuntimeError):
    """The learner's thread ended with an error; the text is its traceback."""


def send(connection: socket.socket, message: Message) -> None:
    """Answer; whoever is gone will ask again and find the answer in the ledger."""
    try:
        connection.sendall(pack(message))
    except OSError:  # half of it may have been sent: the event loop closes the connection
        with contextlib.suppress(OSError):
            connection.shutdown(socket.SHUT_RDWR)


def main(spec: dict[str, Any], places: Places, listener: socket.socket, control: socket.socket, parent: int) -> int:
    """The life of a forked execution; returns its exit code."""
    die_with_parent(parent)
    sys.setswitchinterval(SWITCH_SECONDS)
    setproctitle.setproctitle(f"shepherd: execution {spec['number']} of {spec['agent_id']}")
    os.chdir(Path("/"))
    return Child(ExecutionSpec.from_dict(spec), places, listener, control).run()
