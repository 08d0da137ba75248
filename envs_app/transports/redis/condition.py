"""What an execution says of itself with every sign of life: shared.Fleet reads it in every web process."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import msgpack

from envs_app.execution.worker import ExecutionSpec
from envs_app.messages import Message
from envs_app.transports.measure import Meter
from envs_app.transports.redis import keys, scripts

MEMORY_EVERY = 10  # signs of life between two measurements


@dataclass
class Place:
    """Where an execution runs, and what it may."""

    pid: int
    machine: str
    queue: str
    percent: float  # of a CPU that its agent may use
    idle_seconds: float
    ledger_seconds: float  # that the state of a silent session is kept


@dataclass
class Condition:
    """How an execution stands."""

    spec: ExecutionSpec
    place: Place
    state: str = "starting"  # then ready, stopping
    active: set[int] = field(default_factory=set)  # sessions in the middle of an episode
    saves_answered: int = 0
    published: int = 0  # versions of its policy
    status: dict[str, Any] = field(default_factory=dict)
    started: float = field(default_factory=time.time)

    def __post_init__(self) -> None:
        self._meter, self._beats = Meter(self.place.pid), 0
        self._measured: dict[str, Any] = self._meter.figures()
        self._metered_at = time.monotonic()

    def note(self, message: Message) -> None:
        """Take over what it reports."""
        match message["k"]:
            case "ready":
                self.state = "ready"
            case "took":
                self.active.add(message["session"])
            case "released":
                self.active.discard(message["session"])
            case "save_answered":
                self.saves_answered = message["ticket"]
            case "status":
                self.status = message["status"]

    def measure(self) -> float:
        """Once a second; returns the CPU seconds that it has used since the last time."""
        now = time.monotonic()
        elapsed, self._metered_at = max(now - self._metered_at, 0.001), now
        used = self._meter.update(self.status["steps"], elapsed)
        if self._beats % MEMORY_EVERY == 0:
            self._measured = self._meter.figures()
        self._beats += 1
        self._measured |= {"cpu_percent": round(self._meter.cpu_percent, 1)}
        self._measured |= {"steps_per_second": round(self._meter.steps_per_second, 1)}
        return used

    def sign_of_life(self, reason: str, server: str) -> tuple[Any, ...]:
        """The command that gives it. `reason`: why it ends, if it does; `server`: the run of Redis that watches over it."""
        spec, agent = self.spec, self.spec.agent_id
        lease = {"starting": keys.BUILD_LEASE, "ready": keys.LEASE, "stopping": keys.STOP_LEASE}[self.state]
        names = [keys.lease(spec.uid), keys.executions(agent), keys.AGENTS, keys.running(self.place.queue)]
        names += [keys.peers(spec.run), keys.weights(spec.uid), keys.alive(spec.uid)]
        return scripts.script(
            scripts.BEAT,
            names,
            spec.uid,
            msgpack.packb(self._facts(reason) | {"lease": lease}),
            keys.ms(lease),
            keys.ms(keys.AGENT),
            agent,
            int(self.state != "stopping"),
            spec.number,
            self._as_peer(),
            server,
        )

    def _as_peer(self) -> bytes:
        """What RedisPeers of others read; nothing while it does not advise."""
        if not self.published or self.state != "ready":
            return b""
        mean = self.status.get("mean_return")
        return msgpack.packb({"uid": self.spec.uid, "version": self.published, "mean": mean, "k": "peer"})

    def _facts(self, reason: str) -> dict[str, Any]:
        status = dict(self.status)
        silent_since = status.pop("silent_since", None)
        return {
            "k": "execution",
            "number": self.spec.number,
            "run": self.spec.run,
            "sessions_allowed": self.spec.sessions,
            "reclaim_seconds": self.spec.reclaim_seconds,
            "state": self.state,
            "reason": reason,
            "queue": self.place.queue,
            "active": list(self.active),
            "saves_answered": self.saves_answered,
            "status": status,
            "started": self.started,
            "measured": self._measured | {"machine": self.place.machine},
            "silent": None if silent_since is None else time.monotonic() - silent_since,
        }
