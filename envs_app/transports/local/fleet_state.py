"""What the parent knows of its executions: who serves whom, who is free, who may be started."""

from __future__ import annotations

import contextlib
import socket
import time
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, NoReturn

from envs_app.errors import NoCapacity
from envs_app.messages import FrameReader, Message, pack
from envs_app.transports.local.queue import GONE_SECONDS, Queue
from envs_app.transports.local.quota import Bucket

RESERVED_SECONDS = 30.0  # a place that was given out and never taken is free again,
CROWDED_SECONDS = 2.0  # and so soon when somebody else waits for one
FAILURES, FAILURE_SECONDS = 3, 60.0  # so many failures in so long, and the agent waits
SOON = 0.1


@dataclass
class Execution:
    """A live child."""

    uid: str
    number: int
    run: int
    agent: str
    pid: int
    control: socket.socket
    sessions_allowed: int
    reclaim_seconds: float = 120.0  # a session that is silent for so long may lose its place
    frames: FrameReader = field(default_factory=FrameReader)
    outbox: bytearray = field(default_factory=bytearray)  # told, and not read yet
    heard_at: float = field(default_factory=time.monotonic)
    started: float = field(default_factory=time.time)
    state: str = "starting"  # then ready, stopping
    stop_reason: str = ""
    stopping_since: float = 0.0
    active: set[int] = field(default_factory=set)  # sessions in the middle of an episode
    reserved: dict[int, float] = field(default_factory=dict)  # given out, not taken yet; since when
    homes: set[int] = field(default_factory=set)  # sessions that it has served
    used_at: float = field(default_factory=time.monotonic)
    published: int = 0  # versions of its policy
    saves_asked: int = 0
    saves_answered: int = 0
    status: dict[str, Any] = field(default_factory=dict)
    cpu_seconds: float = 0.0
    cpu_percent: float = 0.0
    steps_before: int = 0
    steps_per_second: float = 0.0

    def tell(self, message: Message) -> None:
        """Send a control message, now or when the child reads again: one that hangs must not hold the parent up."""
        self.outbox += pack(message)
        self.flush()

    def flush(self) -> None:
        """Send what the child will take; that it is dead is noticed elsewhere."""
        with contextlib.suppress(OSError):
            while self.outbox:
                del self.outbox[: self.control.send(self.outbox, socket.MSG_DONTWAIT)]

    def load(self, patience: float = RESERVED_SECONDS) -> int:
        """Places that are taken, or were promised within the last `patience` seconds."""
        now = time.monotonic()
        self.reserved = {session: at for session, at in self.reserved.items() if now - at <= RESERVED_SECONDS}
        return len(self.active | {session for session, at in self.reserved.items() if now - at <= patience})

    def gives(self, session: int) -> None:
        """Promise a place to the session."""
        if session not in self.active:
            self.reserved[session] = time.monotonic()
        self.used_at = time.monotonic()

    def drop(self, session: int) -> None:
        """The session has no place here any more."""
        self.active.discard(session)
        self.reserved.pop(session, None)


class Population:
    """All executions of this machine."""

    def __init__(self, most: int) -> None:
        self.most = most
        self.by_uid: dict[str, Execution] = {}
        self.buckets: dict[str, Bucket] = {}
        self.failures: dict[str, list[float]] = {}
        self.queues: defaultdict[int, Queue] = defaultdict(Queue)  # by run

    def of_agent(self, agent: str) -> list[Execution]:
        """Its executions, by number."""
        return sorted((e for e in self.by_uid.values() if e.agent == agent), key=lambda e: e.number)

    def find(self, claim: Message, exclude: Iterable[str]) -> Execution | None:
        """The execution that shall serve the session; None: one may be launched. Raises NoCapacity."""
        session, excluded = claim["session"], set(exclude)
        mates = [e for e in self.of_agent(claim["agent"]) if e.run == claim["run"]]
        if any(e.state == "stopping" and e.stop_reason != "idle" for e in mates):
            raise NoCapacity("The agent's executions are being saved; repeat the step.", SOON)
        for execution in mates:
            if execution.uid in excluded:
                execution.drop(session)
                execution.tell({"k": "forget", "session": session})
        allowed = [e for e in mates if e.uid not in excluded and e.state != "stopping"]
        chosen = self._serving(allowed, session) or self._free(allowed, claim)
        if chosen is None and not self._may_launch(claim):
            chosen = (
                self._reclaimable(allowed) or self._free(allowed, claim, CROWDED_SECONDS) or self._wait(mates, claim)
            )
        self.queues[claim["run"]].leave(session)
        return chosen

    def _serving(self, mates: list[Execution], session: int) -> Execution | None:
        return next((e for e in mates if session in e.active or session in e.reserved), None)

    def _free(self, mates: list[Execution], claim: Message, patience: float = RESERVED_SECONDS) -> Execution | None:
        """One that the session had if it is free, else the one with the most free places; none if others wait for them."""
        session, places = claim["session"], claim["sessions_per_execution"]
        loads = {e.uid: e.load(patience) for e in mates}
        free = [e for e in mates if loads[e.uid] < places]
        if self.queues[claim["run"]].position(session) >= sum(places - loads[e.uid] for e in free):
            return None
        return min(free, key=lambda e: (session not in e.homes, loads[e.uid], e.number))

    def _may_launch(self, claim: Message) -> bool:
        self._check_failures(claim["agent"])
        return len(self.of_agent(claim["agent"])) < claim["max_executions"] and len(self.by_uid) < self.most

    def _reclaimable(self, mates: list[Execution]) -> Execution | None:
        """One with a session that has been silent for too long; it decides itself whether that one loses its place."""
        now = time.monotonic()
        silent = {e.uid: e.status.get("silent_since") or now for e in mates}
        stale = [e for e in mates if now - silent[e.uid] >= e.reclaim_seconds]
        return min(stale, key=lambda e: silent[e.uid], default=None)

    def _wait(self, mates: list[Execution], claim: Message) -> NoReturn:
        """Have the session wait for its turn, and the executions give their places up when an episode ends."""
        pause = 1.0
        if claim["waits"]:
            pause = self.queues[claim["run"]].join(claim["session"])
            for execution in mates:
                execution.tell({"k": "crowded", "seconds": GONE_SECONDS})
        raise NoCapacity("All executions of the agent are in use; repeat the step later.", pause)

    def note_failure(self, agent: str) -> None:
        """An execution of the agent failed."""
        self.failures.setdefault(agent, []).append(time.monotonic())

    def _check_failures(self, agent: str) -> None:
        now = time.monotonic()
        recent = [at for at in self.failures.get(agent, []) if now - at < FAILURE_SECONDS]
        self.failures[agent] = recent
        if len(recent) >= FAILURES:
            wait = FAILURE_SECONDS - (now - recent[-FAILURES])
            raise NoCapacity("The agent's executions fail; its owner finds the reason in the admin.", min(wait, 10.0))
