"""What web processes and executions know of an agent's executions, in Redis.

Two kinds of facts. What an execution *is* (its sessions, its state) it writes itself, with every sign of life; so nobody
contends for it, and a Redis that lost its memory learns it anew within a second. What was *decided* about executions (a launch,
a promised place, who waits, who shall stop) is one small value per agent, read, changed by the rules of `population`, and
written by compare-and-set: of two that claim the same place at once, one writes, and the other reads again.

Times are Redis's own, in seconds, so that the clocks of machines do not matter.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from threading import RLock
from typing import Any, TypeVar

import msgpack

from envs_app.errors import NoCapacity, ShepherdError
from envs_app.messages import Message, unpack
from envs_app.transports.population import Execution, Population
from envs_app.transports.queue import Queue
from envs_app.transports.redis import keys, scripts
from envs_app.transports.redis.wire import Wire

DECIDED = (
    *("number", "run", "sessions_allowed", "reclaim_seconds", "reserved", "stop_reason", "saves_asked", "launched"),
    "crowded_at",
)
SAID = ("number", "run", "sessions_allowed", "reclaim_seconds", "state", "saves_answered", "status", "started")
STRIPES, TURN_SECONDS = 64, 0.1  # of locks by agent
TRIES = 100  # of a compare-and-set; each fails only because somebody else's succeeded

T = TypeVar("T")


@dataclass(kw_only=True)
class RedisExecution(Execution):
    """An execution somewhere."""

    launched: float = 0.0
    measured: dict[str, Any] = field(default_factory=dict)
    outbox: list[Message] = field(default_factory=list)

    def tell(self, message: Message) -> None:
        """Send it with what is written of the agent."""
        self.outbox.append(message)

    def decided(self) -> dict[str, Any]:
        """What others decided about it."""
        return {name: getattr(self, name) for name in DECIDED}


class Fleet(Population[RedisExecution]):
    """An agent's executions as they stand at one moment of Redis's time."""

    def __init__(self, agent: str, now: float) -> None:
        super().__init__(most=0, clock=lambda: now)
        self.agent, self.now, self.raw = agent, now, b""
        self.room: Callable[[], int] = lambda: 0  # how many more the machines take: asked only where it matters

    def _has_room(self) -> bool:
        return self.room() > 0

    def pack(self) -> bytes:
        """What was decided, for Redis."""
        decided = {uid: execution.decided() for uid, execution in self.by_uid.items()}
        queues = {run: queue.asked for run, queue in self.queues.items() if queue.asked}
        return msgpack.packb({"executions": decided, "queues": queues, "failures": self.failures.get(self.agent, [])})

    def read_decided(self, raw: bytes) -> None:
        """Take over what was decided."""
        self.raw = raw
        if not raw:
            return
        data = msgpack.unpackb(raw, strict_map_key=False)
        self.failures[self.agent] = data["failures"]
        for run, asked in data["queues"].items():
            self.queues[run] = Queue(asked, self.clock)
        for uid, facts in data["executions"].items():
            execution = RedisExecution(uid=uid, agent=self.agent, **facts)
            execution.state = "stopping" if execution.stop_reason else "starting"
            self.by_uid[uid] = execution

    def read_said(self, said: dict[str, tuple[float, dict[str, Any]]]) -> None:
        """Take over what executions say of themselves; who should say something by now and does not is dead."""
        for uid, execution in list(self.by_uid.items()):
            if uid not in said and self.now - execution.launched > keys.START_LEASE:
                del self.by_uid[uid]
        for uid, (at, facts) in said.items():
            self._read_one(uid, at, facts)

    def _read_one(self, uid: str, at: float, facts: dict[str, Any]) -> None:
        known = self.by_uid.get(uid)
        if self.now - at > facts["lease"]:
            self.by_uid.pop(uid, None)
            return
        execution = known or RedisExecution(uid=uid, agent=self.agent, number=0, run=0, sessions_allowed=1)
        for name in SAID:
            setattr(execution, name, facts[name])
        execution.active, execution.measured = set(facts["active"]), facts["measured"]
        if (silent := facts["silent"]) is not None:
            execution.status["silent_since"] = at - silent
        if known is not None and known.stop_reason:
            execution.state = "stopping"
        elif execution.state == "stopping":
            execution.stop_reason = facts["reason"]
        execution.reserved = {s: since for s, since in execution.reserved.items() if s not in execution.active}
        self.by_uid[uid] = execution


class Shared:
    """Reads and changes the fleets of agents."""

    def __init__(self, wire: Wire) -> None:
        self.wire = wire
        self._turns = [RLock() for _ in range(STRIPES)]

    def load(self, agent: str, session: int | None = None) -> Fleet:
        """The agent's executions; with a session, also which of them had it last. Raises Unreachable."""
        owner = ("HGET", keys.ledger(session or 0), "owner")
        clock, raw, said, owned = self.wire.ask(
            ("TIME",), ("GET", keys.agent(agent)), ("HGETALL", keys.executions(agent)), owner
        )
        fleet = Fleet(agent, seconds(clock))
        fleet.read_decided(raw or b"")
        fleet.read_said(said_by(said))
        if session is not None and owned and (home := fleet.by_uid.get(owned.decode())):
            home.homes.add(session)
        return fleet

    def edit(self, agent: str, change: Callable[[Fleet], T], session: int | None = None) -> T:
        """Change what is decided of an agent, by compare-and-set. What `change` raises is raised after it is written."""
        with self._turn(agent):
            return self._edit(agent, change, session)

    @contextmanager
    def _turn(self, agent: str) -> Iterator[None]:
        """Threads of one process queue, as all but one would work in vain; but not for long, as Redis may be away."""
        lock = self._turns[hash(agent) % STRIPES]
        mine = lock.acquire(timeout=TURN_SECONDS)
        try:
            yield
        finally:
            if mine:
                lock.release()

    def _edit(self, agent: str, change: Callable[[Fleet], T], session: int | None) -> T:
        for _ in range(TRIES):
            fleet, error = self.load(agent, session), None
            try:
                result = change(fleet)
            except ShepherdError as refusal:
                error = refusal
            if self._commit(fleet):
                if error is not None:
                    raise error
                return result
        raise NoCapacity("Very many sessions look for executions at once; repeat the step.", 0.5)

    def _commit(self, fleet: Fleet) -> bool:
        packed = fleet.pack()
        told = [(keys.inbox(e.uid), msgpack.packb(message)) for e in fleet.by_uid.values() for message in e.outbox]
        if packed == fleet.raw and not told:
            return True
        names = [keys.agent(fleet.agent), *(name for name, _ in told)]
        lifetimes = keys.ms(keys.AGENT), keys.ms(keys.REPLY)
        messages = [message for _, message in told]
        [done] = self.wire.ask(scripts.script(scripts.COMMIT, names, fleet.raw, packed, *lifetimes, *messages))
        return bool(done)

    def agents(self) -> list[str]:
        """Those with live executions."""
        clock, names = self.wire.ask(("TIME",), ("ZRANGE", keys.AGENTS, 0, -1, "WITHSCORES"))
        oldest = (seconds(clock) - keys.BUILD_LEASE) * 1000
        return [name.decode() for name, at in zip(names[::2], map(float, names[1::2]), strict=True) if at >= oldest]

    def dead(self, agent: str) -> list[End]:
        """The executions of an agent that gave signs of life, and give none any more. Raises Unreachable."""
        clock, raw = self.wire.ask(("TIME",), ("HGETALL", keys.executions(agent)))
        now, said = seconds(clock), said_by(raw)
        return [_lost(uid, agent, facts) for uid, (at, facts) in said.items() if now - at > facts["lease"] + keys.LEASE]

    def bury_cut_off(self, agent: str) -> None:
        """Bury the executions of an agent whose processes were killed. Raises Unreachable."""
        with self._turn(agent):  # all who wait for them come at once, and one can do it for all
            self._bury_cut_off(agent)

    def _bury_cut_off(self, agent: str) -> None:
        names = [keys.executions(agent), keys.lease(""), keys.alive("")]
        raw, uids = self.wire.ask(("HGETALL", names[0]), scripts.script(scripts.CUT_OFF, names))
        said = said_by(raw)
        ends = [_lost(uid, agent, said[uid][1]) for uid in map(bytes.decode, uids) if uid in said]
        for end in ends:  # all of them, before whoever waits for one looks for another
            self.hang_up(agent, end.uid, end.queue, over=True)
        for end in ends:
            self.bury(end)

    def event(self, event: dict[str, Any]) -> None:
        """Something happened, for the housekeeping."""
        self.wire.ask(scripts.script(scripts.EVENT, [keys.STREAM], msgpack.packb(event), keys.ms(keys.EVENTS)))

    def hang_up(self, agent: str, uid: str, queue: str, over: bool = False) -> None:
        """The execution serves nobody any more; `over`: and nobody needs to know of it."""
        names = [keys.pending(uid), keys.inbox(uid), keys.lease(uid), keys.weights(uid)]
        names += [keys.running(queue), keys.executions(agent)]
        arguments = msgpack.packb({"k": "gone"}), keys.ms(keys.REPLY), uid, int(over)
        self.wire.ask(scripts.script(scripts.BURY, names, *arguments))

    def bury(self, end: End) -> None:
        """An execution is over. May be done twice: whoever comes second does nothing."""
        self.hang_up(end.agent, end.uid, end.queue, over=True)
        self.wire.ask(("HDEL", keys.peers(end.run), end.number))

        def forget(fleet: Fleet) -> RedisExecution | None:
            if end.failed:
                fleet.note_failure(end.agent)
            return fleet.by_uid.pop(end.uid, None)

        self.edit(end.agent, forget)
        self.event({"k": "ended", "reason": end.reason, "code": end.code, "at": time.time(), **end.where()})


@dataclass(frozen=True)
class End:
    """How an execution ended."""

    uid: str
    number: int
    run: int
    agent: str
    queue: str
    reason: str
    code: int
    failed: bool  # by itself; one that was killed when it was ready is replaced at once

    def where(self) -> dict[str, Any]:
        """For events."""
        return {"uid": self.uid, "agent": self.agent, "run": self.run}


def _lost(uid: str, agent: str, facts: dict[str, Any]) -> End:
    """The end of an execution that told nobody; `facts`: what it said of itself."""
    return End(uid, facts["number"], facts["run"], agent, facts["queue"], "lost", 0, failed=False)


def seconds(clock: list[bytes]) -> float:
    """Redis's TIME."""
    return int(clock[0]) + int(clock[1]) / 1e6


def said_by(raw: list[bytes]) -> dict[str, tuple[float, dict[str, Any]]]:
    """A hash of signs of life: by name, when it was said, and what."""
    found = {}
    for name, value in zip(raw[::2], raw[1::2], strict=True):
        at, _, facts = value.partition(b":")
        found[name.decode()] = int(at) / 1000, unpack(facts)
    return found
