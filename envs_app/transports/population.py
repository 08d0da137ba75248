"""Who serves whom, who is free, who may be started: the same rules for executions of one machine and of many."""

from __future__ import annotations

import signal
import time
from abc import ABC, abstractmethod
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Generic, NoReturn, TypeVar

from envs_app.errors import NoCapacity
from envs_app.messages import Message
from envs_app.transports.queue import GONE_SECONDS, Queue

RESERVED_SECONDS = 30.0  # a place that was given out and never taken is free again,
CROWDED_SECONDS = 2.0  # and so soon when somebody else waits for one
TELL_SECONDS = 1.0  # an execution that was told so lately that others wait knows it
FAILURES, FAILURE_SECONDS = 3, 60.0  # so many failures in so long, and the agent waits
SOON = 0.1
IDLE, PARENT_GONE = "idle", "parent gone"  # reasons to end for which nobody waits until all is saved


@dataclass
class Execution(ABC):
    """A live execution. Times are of its population's clock."""

    uid: str
    number: int
    run: int
    agent: str
    sessions_allowed: int
    reclaim_seconds: float = 120.0  # a session that is silent for so long may lose its place
    started: float = field(default_factory=time.time)  # of the calendar
    state: str = "starting"  # then ready, stopping
    stop_reason: str = ""
    stopping_since: float = 0.0
    crowded_at: float = -TELL_SECONDS  # when it was told last that others wait
    active: set[int] = field(default_factory=set)  # sessions in the middle of an episode
    reserved: dict[int, float] = field(default_factory=dict)  # given out, not taken yet; since when
    homes: set[int] = field(default_factory=set)  # sessions that it has served
    used_at: float = 0.0
    published: int = 0  # versions of its policy
    saves_asked: int = 0
    saves_answered: int = 0
    status: dict[str, Any] = field(default_factory=dict)

    @abstractmethod
    def tell(self, message: Message) -> None:
        """Send a control message; one that hangs must hold nobody up."""

    def load(self, now: float, patience: float = RESERVED_SECONDS) -> int:
        """Places that are taken, or were promised within the last `patience` seconds."""
        self.reserved = {session: at for session, at in self.reserved.items() if now - at <= RESERVED_SECONDS}
        return len(self.active | {session for session, at in self.reserved.items() if now - at <= patience})

    def gives(self, session: int, now: float) -> None:
        """Promise a place to the session."""
        if session not in self.active:
            self.reserved[session] = now
        self.used_at = now

    def drop(self, session: int) -> None:
        """The session has no place here any more."""
        self.active.discard(session)
        self.reserved.pop(session, None)


def why_killed(code: int) -> str:
    """What the owner of an agent is told of an execution that a signal ended (or that left without a word)."""
    if code >= 0:
        return f"the execution ended with exit code {code}"
    return f"the execution was ended by {signal.Signals(-code).name}; if nobody did, memory was short"


E = TypeVar("E", bound=Execution)


class Population(Generic[E]):
    """All executions that share their places: of this machine, or of an agent."""

    def __init__(self, most: int, clock: Callable[[], float] = time.monotonic) -> None:
        """`most`: executions there may be."""
        self.most, self.clock = most, clock
        self.by_uid: dict[str, E] = {}
        self.failures: dict[str, list[float]] = {}
        self.queues: defaultdict[int, Queue] = defaultdict(lambda: Queue(clock=clock))  # by run

    def of_agent(self, agent: str) -> list[E]:
        """Its executions, by number."""
        return sorted((e for e in self.by_uid.values() if e.agent == agent), key=lambda e: e.number)

    def find(self, claim: Message, exclude: Iterable[str]) -> E | None:
        """The execution that shall serve the session; None: one may be launched. Raises NoCapacity."""
        session, excluded = claim["session"], set(exclude)
        mates = [e for e in self.of_agent(claim["agent"]) if e.run == claim["run"]]
        if any(e.state == "stopping" and e.stop_reason not in (IDLE, PARENT_GONE) for e in mates):
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

    def _serving(self, mates: list[E], session: int) -> E | None:
        return next((e for e in mates if session in e.active or session in e.reserved), None)

    def _free(self, mates: list[E], claim: Message, patience: float = RESERVED_SECONDS) -> E | None:
        """One that the session had if it is free, else the one with the most free places; none if others wait for them."""
        session, places = claim["session"], claim["sessions_per_execution"]
        loads = {e.uid: e.load(self.clock(), patience) for e in mates}
        free = [e for e in mates if loads[e.uid] < places]
        if self.queues[claim["run"]].position(session) >= sum(places - loads[e.uid] for e in free):
            return None
        return min(free, key=lambda e: (session not in e.homes, loads[e.uid], e.number))

    def _may_launch(self, claim: Message) -> bool:
        self._check_failures(claim["agent"])
        live = [e for e in self.of_agent(claim["agent"]) if e.stop_reason != PARENT_GONE]
        return len(live) < claim["max_executions"] and self._has_room()

    def _has_room(self) -> bool:
        return len(self.by_uid) < self.most

    def _reclaimable(self, mates: list[E]) -> E | None:
        """One with a session that has been silent for too long; it decides itself whether that one loses its place."""
        now = self.clock()
        silent = {e.uid: e.status.get("silent_since") or now for e in mates}
        stale = [e for e in mates if now - silent[e.uid] >= e.reclaim_seconds]
        return min(stale, key=lambda e: silent[e.uid], default=None)

    def _wait(self, mates: list[E], claim: Message) -> NoReturn:
        """Have the session wait for its turn, and the executions give their places up when an episode ends."""
        pause = 1.0
        if claim["waits"]:
            pause = self.queues[claim["run"]].join(claim["session"])
            for execution in mates:
                if self.clock() - execution.crowded_at >= TELL_SECONDS:
                    execution.crowded_at = self.clock()
                    execution.tell({"k": "crowded", "seconds": GONE_SECONDS})
        raise NoCapacity("All executions of the agent are in use; repeat the step later.", pause)

    def note_failure(self, agent: str) -> None:
        """An execution of the agent failed."""
        self.failures.setdefault(agent, []).append(self.clock())

    def _check_failures(self, agent: str) -> None:
        now = self.clock()
        recent = [at for at in self.failures.get(agent, []) if now - at < FAILURE_SECONDS]
        self.failures[agent] = recent
        if len(recent) >= FAILURES:
            wait = FAILURE_SECONDS - (now - recent[-FAILURES])
            raise NoCapacity("The agent's executions fail; its owner finds the reason in the admin.", min(wait, 10.0))

    def describe(self, execution: E, measured: dict[str, Any]) -> dict[str, Any]:
        """What the admin shows of an execution (agents_app.fleet.ExecutionStatus); `measured`: of its process."""
        mates = [e for e in self.by_uid.values() if e.run == execution.run and e is not execution]
        state = execution.state if execution.state != "ready" else ("acting" if execution.active else "waiting")
        return {
            **execution.status,
            "uid": execution.uid,
            "number": execution.number,
            "run": execution.run,
            "agent": execution.agent,
            "state": state,
            "started_at": execution.started,
            "saving": execution.saves_answered < execution.saves_asked,
            "active_sessions": sorted(execution.active),
            "sessions": len(execution.active),
            "advises": [mate.number for mate in mates if execution.number in mate.status.get("advisors", [])],
            **measured,
        }
