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
import selectors
import time
from collections import deque
from dataclasses import dataclass
from threading import Lock
from typing import Any

import msgpack
import numpy as np
from redis.exceptions import RedisError

from envs_app.execution.storage import Storage
from envs_app.execution.worker import ExecutionSpec
from envs_app.messages import Message, unpack
from envs_app.transports.loop import STATUS_SECONDS, ExecutionLoop, is_step
from envs_app.transports.measure import Meter
from envs_app.transports.population import PARENT_GONE
from envs_app.transports.quota import Bucket
from envs_app.transports.redis import keys, scripts
from envs_app.transports.redis.ledger import RedisLedger
from envs_app.transports.redis.shared import TRIES, End, Shared, said_by, seconds
from envs_app.transports.redis.vital import Vital
from envs_app.transports.redis.wire import Unreachable, Wire

AT_ONCE = 32  # messages taken from the inbox together
LISTEN_SECONDS = 20.0  # then it listens anew: a connection may be dead and not know it
AGAIN_SECONDS = 0.2  # between attempts to reach Redis
MEMORY_EVERY = 10  # signs of life between two measurements

log = logging.getLogger("shepherd.execution")


@dataclass
class Place:
    """Where an execution runs, and what it may."""

    pid: int
    machine: str
    queue: str
    percent: float  # of a CPU that its agent may use
    idle_seconds: float
    ledger_seconds: float  # that the state of a silent session is kept


class RedisPeers:
    """The policies that the run's other executions published."""

    def __init__(self, wire: Wire, run: int, number: int) -> None:
        self._wire, self._run, self._number = wire, run, number
        self._known: dict[int, tuple[str, int, float | None]] = {}  # uid, version, mean return

    def read(self, raw: list[bytes], now: float) -> None:
        """Take over the hash `peers` of the run."""
        said = said_by(raw)
        live = {int(number): facts for number, (at, facts) in said.items() if now - at <= keys.LEASE}
        live.pop(self._number, None)
        self._known = {number: (facts["uid"], facts["version"], facts["mean"]) for number, facts in live.items()}

    def uids(self) -> list[str]:
        """The live peers."""
        return [uid for uid, _, _ in self._known.values()]

    def versions(self) -> dict[int, int]:
        """The live peers that have published."""
        return {number: version for number, (_, version, _) in self._known.items()}

    def mean_returns(self) -> dict[int, float]:
        """Of those that have ended an episode."""
        return {number: mean for number, (_, _, mean) in self._known.items() if mean is not None}

    def weights(self, number: int) -> np.ndarray | None:
        """The latest weights of a peer."""
        try:
            [raw] = self._wire.ask(("GET", keys.weights(self._known[number][0])))
        except (Unreachable, KeyError):
            return None
        return None if raw is None else np.frombuffer(raw, np.float32)


class RedisChild(ExecutionLoop):
    """An execution that listens at its inbox."""

    publish_seconds = 0.2  # the weights travel
    heartbeat_seconds = STATUS_SECONDS
    peers: RedisPeers
    ledger: RedisLedger

    def __init__(self, spec: ExecutionSpec, wire: Wire, place: Place, storage: Storage) -> None:
        super().__init__(spec, RedisPeers(wire, spec.run, spec.number))
        self.wire, self.place, self.shared, self.storage = wire, place, Shared(wire), storage
        self.state, self.active, self.saves_answered, self.published = "starting", set[int](), 0, 0
        self.status: dict[str, Any] = {}
        self.meter, self.beats = Meter(place.pid), 0
        self.measured = self.meter.figures()
        self.metered_at, self.started = time.monotonic(), time.time()
        self.weights: bytes | None = None
        self.unsaid: deque[dict[str, Any]] = deque(maxlen=1000)  # events that Redis has not taken yet
        self.unsent: deque[tuple[Any, Message]] = deque(maxlen=1000)  # answers, likewise
        self.beating = Lock()  # the learner reports, too
        self.vital, self.parent = Vital(wire, spec.uid), os.getppid()
        self.connection: Any = None
        self.listening: Any = None
        self.taken: list[int] = []  # sessions that somebody else has now
        self.listened_at = self.tried_at = self.answered_at = 0.0

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
        self._listen()

    def tend(self) -> None:
        """Let go of sessions that were taken; listen again, and answer again, where Redis was away."""
        now = time.monotonic()
        while self.taken:
            self.obey({"k": "forget", "session": self.taken.pop()})
        if self.connection is not None and now - self.listened_at > LISTEN_SECONDS + 2 * STATUS_SECONDS:
            self._stop_listening()
        if self.connection is None and now - self.tried_at > AGAIN_SECONDS:
            self._listen_again()
        if self.unsent and now - self.answered_at > AGAIN_SECONDS:
            self.answered_at = now
            self._send_again()

    def _listen_again(self) -> None:
        """And say at once that it lives: a Redis that was started again knows nobody."""
        self._listen()
        if self.connection is not None:
            self.beat()

    def _listen(self) -> None:
        self.tried_at = time.monotonic()
        try:
            self.connection = self.wire.connect()
            self._ask_for_more()
        except (Unreachable, RedisError) as error:
            log.warning("execution %s does not reach Redis: %s", self.spec.number, error)
            self._stop_listening()
            self.nap = AGAIN_SECONDS
        else:
            self.nap = STATUS_SECONDS
            self.listening = self.connection._sock  # redis-py offers no other way to wait for it beside something else
            self.selector.register(self.listening, selectors.EVENT_READ, self._hear)

    def _stop_listening(self) -> None:
        if self.listening is not None:
            self.selector.unregister(self.listening)
        if self.connection is not None:
            self.connection.disconnect()
        self.connection = self.listening = None

    def _ask_for_more(self) -> None:
        self.listened_at = time.monotonic()
        self.connection.send_command("BLMPOP", LISTEN_SECONDS, 1, keys.inbox(self.spec.uid), "LEFT", "COUNT", AT_ONCE)

    def _hear(self, _: Any) -> None:
        found = None
        try:
            found = self.connection.read_response()
            self._ask_for_more()  # before the messages are served, so that nobody waits for them
        except (RedisError, OSError):
            self._stop_listening()
        for raw in found[1] if found else ():
            self._serve(unpack(raw))

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
        match message["k"]:
            case "ready":
                self.state = "ready"
            case "took":
                self.active.add(message["session"])
            case "released":
                self.active.discard(message["session"])
            case "status":
                self._take_stock(message)
            case "save_answered":
                self.saves_answered = message["ticket"]
            case "error" | "saved":
                where = {"uid": self.spec.uid, "agent": self.spec.agent_id, "run": self.spec.run, "at": time.time()}
                self.unsaid.append({**where, **message})
        self.beat()

    def _on_signal(self, number: int, frame: Any) -> None:
        """Told to end, or the kernel says that the worker was killed (serving.bond)."""
        self.reason = self.reason or ("stop" if os.getppid() == self.parent else PARENT_GONE)

    def hang_up(self) -> None:
        """Whoever waits is told so now."""
        self.state = "stopping"
        self._stop_listening()
        try:
            self.shared.hang_up(self.spec.agent_id, self.spec.uid, self.place.queue)
        except Unreachable as error:
            log.warning("execution %s hangs up, and nobody can be told: %s", self.spec.number, error)

    def put_policy(self, weights: np.ndarray) -> None:
        """A value; the peers are told that there is a new one."""
        self.weights = weights.astype(np.float32).tobytes()
        self.published += 1
        hint, lifetime = msgpack.packb({"k": "peers"}), keys.ms(keys.REPLY)
        inboxes = [keys.inbox(uid) for uid in self.peers.uids()]
        tell = [command for name in inboxes for command in (("RPUSH", name, hint), ("PEXPIRE", name, lifetime))]
        try:
            self.wire.ask(("SET", keys.weights(self.spec.uid), self.weights, "PX", keys.ms(keys.AGENT)))
            self.beat()
            if tell:
                self.wire.ask(*tell)
        except Unreachable as error:
            log.warning("execution %s cannot publish: %s", self.spec.number, error)

    def beat(self) -> None:
        """A sign of life, with what others must know; from either thread."""
        try:
            with self.beating:
                [(known, listens)] = self.wire.ask(self._sign_of_life())
                if not listens and self.state != "stopping":
                    self.vital.hold()
                self._say()
            if not known and self.state == "ready":
                self._remind()
        except Unreachable as error:
            log.warning("execution %s gives no sign of life: %s", self.spec.number, error)

    def _sign_of_life(self) -> tuple[Any, ...]:
        spec, agent = self.spec, self.spec.agent_id
        lease = {"starting": keys.BUILD_LEASE, "ready": keys.LEASE, "stopping": keys.STOP_LEASE}[self.state]
        peer = {"uid": spec.uid, "version": self.published, "mean": self.status.get("mean_return"), "k": "peer"}
        names = [keys.lease(spec.uid), keys.executions(agent), keys.AGENTS, keys.running(self.place.queue)]
        names += [keys.peers(spec.run), keys.weights(spec.uid), keys.alive(spec.uid)]
        advises = self.published and self.state == "ready"
        return scripts.script(
            scripts.BEAT,
            names,
            spec.uid,
            msgpack.packb(self._facts() | {"lease": lease}),
            keys.ms(lease),
            keys.ms(keys.AGENT),
            agent,
            int(self.state != "stopping"),
            spec.number,
            msgpack.packb(peer) if advises else b"",
            self.vital.server,
        )

    def _facts(self) -> dict[str, Any]:
        """What shared.Fleet reads."""
        status = dict(self.status)
        silent_since = status.pop("silent_since", None)
        return {
            "k": "execution",
            "number": self.spec.number,
            "run": self.spec.run,
            "sessions_allowed": self.spec.sessions,
            "reclaim_seconds": self.spec.reclaim_seconds,
            "state": self.state,
            "reason": self.reason,
            "queue": self.place.queue,
            "active": list(self.active),
            "saves_answered": self.saves_answered,
            "status": status,
            "started": self.started,
            "measured": self.measured | {"machine": self.place.machine},
            "silent": None if silent_since is None else time.monotonic() - silent_since,
        }

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

    def _take_stock(self, message: Message) -> None:
        """Once a second: what it uses, whether its agent must pause, who advises, whether anybody still needs it."""
        self.status = message["status"]
        now = time.monotonic()
        elapsed, self.metered_at = max(now - self.metered_at, 0.001), now
        used = self.meter.update(self.status["steps"], elapsed)
        if self.beats % MEMORY_EVERY == 0:
            self.measured = self.meter.figures()
        self.beats += 1
        self.measured |= {"cpu_percent": round(self.meter.cpu_percent, 1)}
        self.measured |= {"steps_per_second": round(self.meter.steps_per_second, 1)}
        if self.state == "ready" and message["idle"] > self.place.idle_seconds:
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
        if self.worker.advisors is not None:
            time_, raw = self.wire.ask(("TIME",), ("HGETALL", keys.peers(self.spec.run)))
            self.peers.read(raw, seconds(time_))


def pay(wire: Wire, name: str, percent: float, used: float) -> float:
    """Take CPU seconds from a bucket that several processes share; returns for how many seconds to pause."""
    for _ in range(TRIES):
        time_, raw = wire.ask(("TIME",), ("GET", name))
        now, bucket = seconds(time_), Bucket(percent)
        at = now
        if raw:
            bucket.level, at = msgpack.unpackb(raw)
        pause = bucket.use(used, max(0.0, now - at))
        new = msgpack.packb((bucket.level, now))
        lifetimes = keys.ms(keys.AGENT), 0
        if wire.ask(scripts.script(scripts.COMMIT, [name], raw or b"", new, *lifetimes))[0]:
            return pause
    return 0.0  # so many pay at once that the next second will do
