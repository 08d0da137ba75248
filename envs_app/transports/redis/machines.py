"""The machines that run executions: what each worker says of itself, and how many executions they still take."""

from __future__ import annotations

import os
from typing import Any

import msgpack

from envs_app.transports.redis import keys, scripts
from envs_app.transports.redis.shared import said_by, seconds
from envs_app.transports.redis.wire import Wire


class Room:
    """How many more executions may be launched."""

    def __init__(self, wire: Wire) -> None:
        self.wire = wire

    def left(self, queue: str | None = None) -> int:
        """Free slots of the machines that serve the queue, or of all. Others may take them at the same moment: then the
        task waits in the queue for the next free one. Raises Unreachable."""
        machines = [machine for machine in self.machines().values() if queue is None or queue in machine["queues"]]
        queues = {queue} if queue else {name for machine in machines for name in machine["queues"]}
        [time] = self.wire.ask(("TIME",))
        counts = [("ZCOUNT", keys.running(name), keys.ms(seconds(time)), "+inf") for name in queues]
        taken = sum(self.wire.ask(*counts)) if counts else 0
        return max(0, sum(machine["slots"] for machine in machines) - taken)

    def machines(self) -> dict[str, dict[str, Any]]:
        """The live workers, by name. Raises Unreachable."""
        time, raw = self.wire.ask(("TIME",), ("HGETALL", keys.MACHINES))
        now = seconds(time)
        return {name: facts for name, (at, facts) in said_by(raw).items() if now - at <= keys.LEASE}

    def settled(self) -> bool:
        """Whether it is known who lives; for a moment after Redis lost its memory, or began, it is not. Raises Unreachable."""
        return bool(self.wire.ask(scripts.script(scripts.SETTLED, []))[0])

    def beat(self, name: str, queues: list[str], slots: int) -> None:
        """A worker's sign of life. Raises Unreachable."""
        facts = msgpack.packb({"k": "machine", "queues": queues, "slots": slots, "pid": os.getpid()})
        self.wire.ask(scripts.script(scripts.BEAT_MACHINE, [keys.MACHINES], name, facts, keys.ms(keys.AGENT)))

    def leave(self, name: str) -> None:
        """The worker takes no more. Raises Unreachable."""
        self.wire.ask(("HDEL", keys.MACHINES, name))
