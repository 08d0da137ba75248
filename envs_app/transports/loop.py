"""The event loop of an execution, whatever its steps come by: one thread acts, one learns."""

from __future__ import annotations

import contextlib
import logging
import selectors
import signal
import socket
import sys
import time
import traceback
from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from envs_app.execution.advisors import Peers
from envs_app.execution.desk import Desk
from envs_app.execution.ledger import Ledger
from envs_app.execution.storage import Storage
from envs_app.execution.worker import ExecutionSpec, Worker
from envs_app.messages import Message

STATUS_SECONDS = 1.0
HEARTBEAT_SECONDS = 5.0  # so often it says at least that it lives
STOP_SECONDS = 12.0  # for the learner's last save; whoever watches over it kills it a little later
STEP_KEYS = {"session", "request", "seq", "claim", "obs", "reward", "terminated", "truncated", "mask"}
SWITCH_SECONDS = (
    0.0005  # a learner in Python code gives way to the actor after so long; 10 times finer than the default
)

log = logging.getLogger("shepherd.execution")


class LearnerFailed(RuntimeError):
    """The learner's thread ended with an error; the text is its traceback."""


class ExecutionLoop(ABC):
    """Serves a desk until it is told to stop. A subclass opens the ways in and out."""

    publish_seconds = 0.05  # A2C would publish a hundred times a second
    heartbeat_seconds = HEARTBEAT_SECONDS

    def __init__(self, spec: ExecutionSpec, peers: Peers) -> None:
        self.spec, self.peers = spec, peers
        self.selector = selectors.DefaultSelector()
        self.wake_reader, self.wake_writer = socket.socketpair()
        for quiet in (self.wake_reader, self.wake_writer):
            quiet.setblocking(False)
        self.reason = ""  # set: the execution ends
        self.nap = STATUS_SECONDS  # the longest
        self.reported_at = self.published_at = self.said_at = 0.0
        self.reported: dict[str, Any] = {}

    def run(self) -> int:
        """Serve until told to stop; returns the exit code."""
        sys.setswitchinterval(SWITCH_SECONDS)
        signal.set_wakeup_fd(self.wake_writer.fileno(), warn_on_full_buffer=False)
        signal.signal(signal.SIGTERM, self._on_signal)
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            self._begin()
            while not self.reason:
                self._turn()
            return self._close()
        except LearnerFailed as failure:
            self._report_failure(str(failure))
        except BaseException:
            self._report_failure(traceback.format_exc())
        return 1

    # --- what a transport gives ---
    @abstractmethod
    def open_ways(self) -> None:
        """Register what steps and control messages come by."""

    @abstractmethod
    def make_storage(self) -> Storage:
        """Where saves are."""

    @abstractmethod
    def make_ledger(self) -> Ledger:
        """Where the states of its sessions are kept; the worker is there."""

    @abstractmethod
    def answer(self, to: Any, message: Message) -> None:
        """Answer a step; whoever is gone will ask again and find the answer in the ledger."""

    @abstractmethod
    def report(self, message: Message) -> None:
        """Tell whoever watches over it; from either thread."""

    @abstractmethod
    def put_policy(self, weights: np.ndarray) -> None:
        """Put the policy where peers find it, and have them told; in the learner's thread."""

    @abstractmethod
    def hang_up(self) -> None:
        """Serve nobody any more: whoever asks is sent elsewhere at once, not when the learner has saved."""

    def tend(self) -> None:  # noqa: B027 - most have nothing to tend
        """Once in each turn of the loop."""

    # --- the loop ---
    def _begin(self) -> None:
        self.worker = Worker(self.spec, self.make_storage(), self.peers, self._publish, self.wake, self.report)
        self.desk = Desk(self.worker, self.make_ledger(), self.answer, self.report)
        self.selector.register(self.wake_reader, selectors.EVENT_READ, self._woken)
        self.open_ways()
        self.report({"k": "ready"})

    def _turn(self) -> None:
        due = self.desk.next_due()
        for key, _ in self.selector.select(self.nap if due is None else min(due, self.nap)):
            key.data(key.fileobj)
        self.tend()
        if due is not None:
            self.desk.wake()
        if self.worker.failure:
            self.desk.abandon()
            raise LearnerFailed(self.worker.failure)
        if time.monotonic() - self.reported_at >= STATUS_SECONDS:
            self.desk.end_unanswered()
            self.desk.catch_up()
            self._report_status()

    def _close(self) -> int:
        self.desk.abandon()
        self.hang_up()
        self._report_status()
        if not self.worker.stop(STOP_SECONDS):
            self._report_failure(f"the learner did not end in {STOP_SECONDS} s: what it learned last is not saved")
        if self.worker.failure:
            self._report_failure(self.worker.failure)
        self.report({"k": "ended", "reason": self.reason})
        return 0

    def _woken(self, reader: socket.socket) -> None:
        with contextlib.suppress(BlockingIOError):
            reader.recv(4096)
        self.desk.wake()

    def wake(self) -> None:
        """From the learner's thread: parked steps may go on. Costs nothing when there are none."""
        if self._somebody_waits():
            with contextlib.suppress(BlockingIOError):
                self.wake_writer.send(b"w")

    def _somebody_waits(self) -> bool:
        """Whether anybody waits for the learner, or it has something to say."""
        return not hasattr(self, "desk") or bool(self.desk.parked) or self.worker.failure is not None

    # --- what it is told, and tells ---
    def obey(self, message: Message) -> None:
        """Do what a control message says."""
        match message["k"]:
            case "stop":
                self.reason = message["reason"]
            case "crowded":
                self.desk.crowded_until = time.monotonic() + message["seconds"]
            case "throttle":
                self.desk.throttled_until = time.monotonic() + message["seconds"]
            case "configure":
                self.configure(message)
            case "save":
                self.worker.save_now(message["ticket"])
            case "forget":
                self.desk.release(message["session"])

    def configure(self, message: Message) -> None:
        """Take over settings that the agent's owner changed."""
        self.worker.set_learning(message.get("learning", self.worker.learning))
        self.desk.set_sessions(message.get("sessions", self.spec.sessions))
        self.worker.learner.save_interval = message.get("save_interval", self.worker.learner.save_interval)
        self.desk.wake()

    def _report_status(self) -> None:
        self.reported_at = time.monotonic()
        status = self.worker.status() | self.desk.status()
        if status != self.reported or self.reported_at - self.said_at >= self.heartbeat_seconds:
            self.reported, self.said_at = status, self.reported_at
            self.report({"k": "status", "status": status, "idle": time.monotonic() - self.desk.used_at})

    def _report_failure(self, text: str) -> None:
        log.error("execution %s of agent %s failed:\n%s", self.spec.number, self.spec.agent_id, text)
        self.report({"k": "error", "summary": _summary(text), "traceback": text, "fatal": True})

    def _publish(self, weights: np.ndarray) -> bool:
        """In the learner's thread. Returns whether it was time to."""
        if time.monotonic() - self.published_at < self.publish_seconds:
            return False
        self.published_at = time.monotonic()
        self.put_policy(weights)
        return True

    def _on_signal(self, number: int, frame: Any) -> None:
        self.reason = self.reason or "stop"


def is_step(message: Message) -> bool:
    """Whether a message has all that a step needs."""
    return message.keys() >= STEP_KEYS


def _summary(text: str) -> str:
    """The line of a traceback that names the error, or the first line of another text."""
    lines = text.splitlines()
    after = max((number for number, line in enumerate(lines) if line.startswith('  File "')), default=-1)
    return next((line for line in lines[after + 1 :] if line[:1].strip()), "failed")
