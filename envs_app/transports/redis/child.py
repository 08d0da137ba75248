"""An execution whose steps come through Redis: a task in a prefork child of a Celery worker.

It blocks on one list, its inbox, for steps and control messages alike; a step costs it one command there and one script back,
which keeps the session's state and answers at once. Lists, because a blocking pop wakes exactly the one who waits, within a
tenth of a millisecond, and needs no group, no acknowledgement and no cursor; what a killed execution had popped is not lost, as
the set `pending` names who waits for it.
"""

from __future__ import annotations

import contextlib
import logging
import os
import time
from collections import deque
from threading import Lock
from typing import Any

import msgpack
import numpy as np

from envs_app.execution.storage import Storage
from envs_app.execution.worker import ExecutionSpec
from envs_app.messages import Message
from envs_app.transports.loop import ExecutionLoop, is_step
from envs_app.transports.population import PARENT_GONE
from envs_app.transports.redis import keys
from envs_app.transports.redis.bucket import pay
from envs_app.transports.redis.condition import Condition, Place
from envs_app.transports.redis.inbox import AGAIN_SECONDS, Inbox
from envs_app.transports.redis.ledger import RedisLedger
from envs_app.transports.redis.peers import RedisPeers
from envs_app.transports.redis.shared import End, Shared, seconds
from envs_app.transports.redis.vital import Vital
from envs_app.transports.redis.wire import Unreachable, Wire

log = logging.getLogger("shepherd.execution")


class RedisChild(ExecutionLoop):
    """An execution that listens at its inbox."""

    publish_seconds = 0.2  # the weights travel
    heartbeat_seconds = keys.LEASE / 3  # where nothing has changed: hundreds of idle ones must cost next to nothing
    peers: RedisPeers
    ledger: RedisLedger

    def __init__(self, spec: ExecutionSpec, wire: Wire, place: Place, storage: Storage) -> None:
        super().__init__(spec, RedisPeers(wire, spec.run, spec.number))
        self.wire, self.place, self.shared, self.storage = wire, place, Shared(wire), storage
        self.condition, self.inbox = Condition(spec, place), Inbox(wire, spec.uid, self.selector, self._serve)
        self.weights: bytes | None = None
        self.unsaid: deque[dict[str, Any]] = deque(maxlen=1000)  # events that Redis has not taken yet
        self.unsent: deque[tuple[Any, Message]] = deque(maxlen=1000)  # answers, likewise
        self.beating = Lock()  # the learner reports, too
        self.vital, self.parent = Vital(wire, spec.uid), os.getppid()
        self.taken: list[int] = []  # sessions that somebody else has now
        self.answered_at = 0.0

    def live(self) -> int:
        """Serve until told to stop, and be buried; returns the exit code."""
        self.vital.hold()
        self.beat()
        code = self.run()
        reason = self.reason if code == 0 else "crash"
        spec = self.spec
        end = End(spec.uid, spec.number, spec.run, spec.agent_id, self.place.queue, reason, code, failed=code != 0)
        try:
            self._say()
            self.shared.bury(end)
        except Unreachable as error:  # its lease ends, and the housekeeping finds it dead
            log.error("execution %s ended, and nobody could be told: %s", self.spec.number, error)
        return code

    # --- listening ---
    def open_ways(self) -> None:
        """The inbox."""
        self.ledger = self.desk.ledger  # type: ignore[assignment]
        self.inbox.open()
        self.nap = self.inbox.nap

    def tend(self) -> None:
        """Let go of sessions that were taken; listen again, and answer again, where Redis was away."""
        while self.taken:
            self.obey({"k": "forget", "session": self.taken.pop()})
        if self.inbox.tend():
            self.beat()  # at once: a Redis that was started again knows nobody
        self.nap = self.inbox.nap
        now = time.monotonic()
        if self.unsent and now - self.answered_at > AGAIN_SECONDS:
            self.answered_at = now
            self._send_again()

    def _serve(self, message: Message) -> None:
        if not is_step(message):
            self.obey(message)
            return
        session, reply = message["session"], message["to"]
        try:
            if message["claim"] and self.ledger.was_taken(session):
                self.obey({"k": "forget", "session": session})
            self.desk.step(message, (session, reply))
        except Unreachable as error:
            log.warning("execution %s cannot serve a step: %s", self.spec.number, error)

    def answer(self, to: Any, message: Message) -> None:
        """By the list that the caller waits on; as soon as Redis takes it."""
        if not self._send(to, message):
            self.unsent.append((to, message))

    def _send_again(self) -> None:
        """But not to a session that is served elsewhere by now."""
        while self.unsent:
            to, message = self.unsent[0]
            if self.ledger.holds(to[0]) and not self._send(to, message):
                return
            self.unsent.popleft()

    def _send(self, to: Any, message: Message) -> bool:
        session, reply = to
        try:
            if not self.ledger.send(session, reply, message):
                self.taken.append(session)  # not released here: the desk is in the middle of its step
        except Unreachable as error:
            log.warning("execution %s cannot answer: %s", self.spec.number, error)
            return False
        return True

    def obey(self, message: Message) -> None:
        """Do what it is told."""
        super().obey(message)
        if message["k"] == "forget":
            self.report({"k": "released", "session": message["session"]})
        elif message["k"] == "peers":
            with contextlib.suppress(Unreachable):  # the next sign of life asks again
                self._ask_for_peers()

    def configure(self, message: Message) -> None:
        """Also the CPU quota."""
        super().configure(message)
        self.place.percent = message.get("max_percent_cpu", self.place.percent)

    # --- telling ---
    def make_ledger(self) -> RedisLedger:
        """In Redis, and in memory."""
        return RedisLedger(self.wire, self.spec.uid, self.place.ledger_seconds)

    def make_storage(self) -> Storage:
        """Where all machines find it."""
        return self.storage

    def report(self, message: Message) -> None:
        """Note it, and give a sign of life."""
        self.condition.note(message)
        if message["k"] == "status":
            self._take_stock(message["idle"])
        elif message["k"] in ("error", "saved"):
            where = {"uid": self.spec.uid, "agent": self.spec.agent_id, "run": self.spec.run, "at": time.time()}
            self.unsaid.append({**where, **message})
        self.beat()

    def _on_signal(self, number: int, frame: Any) -> None:
        """Told to end, or the kernel says that the worker was killed (serving.bond)."""
        self.reason = self.reason or ("stop" if os.getppid() == self.parent else PARENT_GONE)

    def hang_up(self) -> None:
        """Whoever waits is told so now."""
        self.condition.state = "stopping"
        self.inbox.close()
        try:
            self.shared.hang_up(self.spec.agent_id, self.spec.uid, self.place.queue)
        except Unreachable as error:
            log.warning("execution %s hangs up, and nobody can be told: %s", self.spec.number, error)

    def put_policy(self, weights: np.ndarray) -> None:
        """A value; the peers are told that there is a new one."""
        self.weights = weights.astype(np.float32).tobytes()
        hint, lifetime = msgpack.packb({"k": "peers"}), keys.ms(keys.REPLY)
        inboxes = [keys.inbox(uid) for uid in self.peers.uids()]
        tell = [command for name in inboxes for command in (("RPUSH", name, hint), ("PEXPIRE", name, lifetime))]
        try:
            try:
                self.wire.ask(("SET", keys.weights(self.spec.uid), self.weights, "PX", keys.ms(keys.AGENT)))
            finally:
                self.condition.published += 1  # whoever hears of it finds it
            self.beat()
            if tell:
                self.wire.ask(*tell)
        except Unreachable as error:
            log.warning("execution %s cannot publish: %s", self.spec.number, error)

    def beat(self) -> None:
        """A sign of life, with what others must know; from either thread."""
        try:
            with self.beating:
                [(known, listens)] = self.wire.ask(self.condition.sign_of_life(self.reason, self.vital.server))
                if not listens and self.condition.state != "stopping":
                    self.vital.hold()
                self._say()
            if not known and self.condition.state == "ready":
                self._remind()
        except Unreachable as error:
            log.warning("execution %s gives no sign of life: %s", self.spec.number, error)

    def _say(self) -> None:
        """Hand over the events."""
        while self.unsaid:
            self.shared.event(self.unsaid[0])
            self.unsaid.popleft()

    def _remind(self) -> None:
        """Redis has lost its memory, or this process has slept: it is told again."""
        log.warning("execution %s was forgotten, and says again what it knows", self.spec.number)
        self.taken += self.ledger.restore()  # while this machine was cut off, say
        if self.weights is not None:
            self.wire.ask(("SET", keys.weights(self.spec.uid), self.weights, "PX", keys.ms(keys.AGENT)))

    def _take_stock(self, idle: float) -> None:
        """Once a second: what it uses, whether its agent must pause, who advises, whether anybody still needs it."""
        used = self.condition.measure()
        if self.condition.state == "ready" and idle > self.place.idle_seconds:
            self.reason = self.reason or "idle"
        try:
            self._pay(used)
            self._ask_for_peers()
        except Unreachable:
            return  # the sign of life that follows says so

    def _pay(self, used: float) -> None:
        """Take what was used from the agent's CPU quota, which all its executions share."""
        name = keys.bucket(self.spec.agent_id)
        pause = pay(self.wire, name, self.place.percent, used)
        if pause > 0:
            self.desk.throttled_until = time.monotonic() + pause

    def _ask_for_peers(self) -> None:
        if self.worker.advisors is not None or self.worker.averaging is not None:
            time_, raw = self.wire.ask(("TIME",), ("HGETALL", keys.peers(self.spec.run)))
            self.peers.read(raw, seconds(time_))
