"""The web process's side of the Redis transport.

One hop each way: a step is pushed onto its execution's inbox, and its answer popped from a list of its own, by blocking pops; the
two commands travel in one packet. Nothing is polled: who hears nothing for a moment looks whether an answer may yet come.
"""

from __future__ import annotations

import itertools
import os
import time
import uuid
from collections.abc import Callable, Iterable
from dataclasses import asdict
from typing import Any

import msgpack
from django.conf import settings

from envs_app.errors import NoCapacity
from envs_app.messages import Message, unpack
from envs_app.transports.base import Address, Away, Claim, Transport
from envs_app.transports.redis import keys, scripts
from envs_app.transports.redis.crowds import Crowds
from envs_app.transports.redis.machines import Room
from envs_app.transports.redis.queues import queue_of
from envs_app.transports.redis.shared import End, Fleet, RedisExecution, Shared
from envs_app.transports.redis.wire import COMMAND_SECONDS, Wire

LOOK_SECONDS = 0.25  # who hears nothing for so long looks whether an answer may yet come
EVENTS_AT_ONCE = 500


class RedisTransport(Transport):
    """Executions are tasks of Celery workers, anywhere."""

    def __init__(self, url: str = "") -> None:
        self.wire = Wire(url or settings.REDIS_URL)
        self.shared, self.room, self.crowds = Shared(self.wire), Room(self.wire), Crowds()
        self._name = f"{uuid.uuid4().hex[:12]}-{os.getpid()}"
        self._calls = itertools.count()

    def acquire(self, claim: Claim, exclude: Iterable[str] = ()) -> Address | None:
        """By the same rules as everywhere, on what Redis knows."""
        self.crowds.refuse(claim)
        self._refuse_while_settling()
        excluded = list(exclude)

        def choose(fleet: Fleet) -> str | None:
            execution = self._find(fleet, claim, excluded, self.room.left)
            return execution.uid if execution else None

        uid = self.shared.edit(claim.agent, choose, claim.session)
        return Address(uid, claim.agent) if uid else None

    def launch(self, claim: Claim, spec: dict[str, Any], max_percent_cpu: int, exclude: Iterable[str] = ()) -> Address:
        """Enqueue a task. It starts while the first step already waits in its inbox."""
        self._refuse_while_settling()
        queue, excluded = queue_of(spec["agent"]), list(exclude)
        room = self.room.left(queue)
        launched = self._announce(spec, queue)

        def choose(fleet: Fleet) -> str:
            execution = self._find(fleet, claim, excluded, lambda: room) or _launched(fleet, spec)
            execution.gives(claim.session, fleet.now)
            return execution.uid

        try:
            uid = self.shared.edit(claim.agent, choose, claim.session)
        except BaseException:
            self._withdraw(launched)
            raise
        if uid != spec["uid"]:
            self._withdraw(launched)
        else:
            self._enqueue(launched, spec, max_percent_cpu)
        return Address(uid, claim.agent)

    def call(self, address: Address, message: Message, timeout: float) -> Message:
        """Push the step, and wait for its answer."""
        deadline = time.monotonic() + timeout
        reply = keys.reply(f"{self._name}-{next(self._calls)}")
        names = [reply, keys.lease(address.uid), keys.pending(address.uid)]
        frame = msgpack.packb({**message, "to": reply})
        ask = scripts.script(scripts.SEND, [*names, keys.inbox(address.uid)], *TOLD, frame)
        while (left := deadline - time.monotonic()) > 0:
            wait = min(LOOK_SECONDS, max(left, 0.01))
            _, found = self.wire.ask(ask, ("BLPOP", reply, wait), patience=wait + COMMAND_SECONDS)
            if found is not None:
                return self._answer(unpack(found[1]), address)
            ask = scripts.script(scripts.LOOK, [*names, keys.alive(address.uid)], *TOLD, CUT_OFF)
        raise TimeoutError("no answer in time")

    def forget(self, session: int, agent: str) -> None:
        """Tell the execution that has it, and delete its state."""

        def change(fleet: Fleet) -> None:
            for execution in fleet.by_uid.values():
                if session in execution.homes | execution.reserved.keys() | execution.active:
                    execution.drop(session)
                    execution.tell({"k": "forget", "session": session})

        self.shared.edit(agent, change, session)
        self.wire.ask(("DEL", keys.ledger(session)))

    def status(self, agent: str | None = None) -> list[dict[str, Any]]:
        """As each said it last."""
        agents = self.shared.agents() if agent is None else [agent]
        fleets = [self.shared.load(name) for name in agents]
        return [fleet.describe(e, e.measured) for fleet in fleets for e in fleet.of_agent(fleet.agent)]

    def configure(self, agent: str, settings: dict[str, Any]) -> None:
        """Tell all of them."""

        def change(fleet: Fleet) -> None:
            for execution in fleet.by_uid.values():
                execution.tell({"k": "configure", **settings})

        self.shared.edit(agent, change)

    def stop(self, agent: str, reason: str) -> int:
        """Tell all of them, and have none given out."""

        def change(fleet: Fleet) -> int:
            fleet.failures.pop(agent, None)
            for execution in fleet.by_uid.values():
                execution.stop_reason, execution.state = execution.stop_reason or reason, "stopping"
                execution.tell({"k": "stop", "reason": reason})
            return len(fleet.by_uid)

        return self.shared.edit(agent, change)

    def save(self, run: int) -> int:
        """Tell those of the run."""

        def change(fleet: Fleet) -> int:
            mates = [execution for execution in fleet.by_uid.values() if execution.run == run]
            for execution in mates:
                execution.saves_asked += 1
                execution.tell({"k": "save", "ticket": execution.saves_asked})
            return len(mates)

        return sum(self.shared.edit(agent, change) for agent in self.shared.agents())

    def events(self, after: int) -> list[dict[str, Any]]:
        """From the stream; what was read is deleted."""
        trim = ("XTRIM", keys.STREAM, "MINID", f"{after + 1}-0")
        _, found = self.wire.ask(trim, ("XRANGE", keys.STREAM, f"({after}-0", "+", "COUNT", EVENTS_AT_ONCE))
        return [{**unpack(fields[1]), "id": int(number.partition(b"-")[0])} for number, fields in found]

    def sweep(self) -> None:
        """Bury the executions that give no sign of life: their machine is gone."""
        for agent in self.shared.agents():
            for end in self.shared.dead(agent):
                self.shared.bury(end)

    def _answer(self, message: Message, address: Address) -> Message:
        """What came of a step. Raises ConnectionError when its execution is gone, Away when Redis has forgotten it."""
        match message["k"]:
            case "gone":
                raise ConnectionError("the execution is gone")
            case "cut_off":
                self.shared.bury_cut_off(address.where)
                raise ConnectionError("the execution was killed")
            case "away":
                raise Away("Redis has lost its memory")
        return message

    # --- finding ---
    def _find(self, fleet: Fleet, claim: Claim, exclude: list[str], room: Callable[[], int]) -> RedisExecution | None:
        fleet.room = room
        try:
            execution = fleet.find(asdict(claim), exclude)
        except NoCapacity:
            self.crowds.note(fleet, claim.run)
            raise
        if execution is not None:
            execution.gives(claim.session, fleet.now)
        return execution

    def _refuse_while_settling(self) -> None:
        if not self.room.settled():
            raise NoCapacity("The executions are being found again; repeat the step.", 0.5)

    # --- launching ---
    def _announce(self, spec: dict[str, Any], queue: str) -> End:
        """A lease for the execution that will be launched: nobody may take it for dead before it lives."""
        uid, lease = spec["uid"], keys.ms(keys.START_LEASE)
        names = [keys.lease(uid), keys.running(queue), keys.AGENTS]
        self.wire.ask(scripts.script(scripts.ANNOUNCE, names, uid, spec["agent_id"], lease, keys.ms(keys.AGENT)))
        return End(uid, spec["number"], spec["run"], spec["agent_id"], queue, "lost", 0, failed=False)

    def _enqueue(self, launched: End, spec: dict[str, Any], max_percent_cpu: int) -> None:
        """Raises ConnectionError when the broker does not take the task; then the execution never was."""
        from shepherd.celery import enqueue

        try:
            order = {"spec": spec, "queue": launched.queue, "percent": max_percent_cpu, "expires": keys.START_LEASE}
            enqueue(order, launched.uid, launched.queue)
        except Exception as error:
            self.shared.edit(launched.agent, lambda fleet: fleet.by_uid.pop(launched.uid, None))
            self._withdraw(launched)
            raise ConnectionError(f"the broker took no task: {error}") from error

    def _withdraw(self, launched: End) -> None:
        self.shared.hang_up(launched.agent, launched.uid, launched.queue, over=True)


def _launched(fleet: Fleet, spec: dict[str, Any]) -> RedisExecution:
    """A new execution, among the others."""
    execution = RedisExecution(
        uid=spec["uid"],
        number=spec["number"],
        run=spec["run"],
        agent=spec["agent_id"],
        sessions_allowed=spec["sessions"],
        reclaim_seconds=spec["reclaim_seconds"],
        launched=fleet.now,
    )
    fleet.by_uid[execution.uid] = execution
    return execution


TOLD = msgpack.packb({"k": "gone"}), msgpack.packb({"k": "away"}), keys.ms(keys.REPLY)
CUT_OFF = msgpack.packb({"k": "cut_off"})
