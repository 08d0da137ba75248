"""What the parent looks after by itself: executions that hang, do not come to an end, idle or use too much of the processor."""

from __future__ import annotations

import logging
import os
import signal
import time

from envs_app.transports.local.fleet import SILENT_SECONDS, Fleet
from envs_app.transports.local.fleet_state import LocalExecution

TICK_SECONDS = 0.5
STOP_SECONDS = 15.0  # then an execution is killed
AWAY_SECONDS = 5.0  # without a tick: it was this process that slept, with the machine, say

log = logging.getLogger("shepherd.parent")


class Watch:
    """Over a fleet, twice a second."""

    def __init__(self, fleet: Fleet, idle_seconds: float) -> None:
        self.fleet, self.idle_seconds = fleet, idle_seconds
        self.ticked_at = time.monotonic()

    def tick_if_due(self) -> None:
        """Look after all executions, if that was not done just now."""
        now = time.monotonic()
        if now - self.ticked_at < TICK_SECONDS:
            return
        elapsed, self.ticked_at = now - self.ticked_at, now
        self.fleet.reap()
        self._tick(now, elapsed)

    def _tick(self, now: float, elapsed: float) -> None:
        used: dict[str, float] = {}
        for execution in list(self.fleet.population.by_uid.values()):
            if elapsed > AWAY_SECONDS:
                execution.heard_at = now
            execution.flush()
            seconds = execution.meter.update(execution.status.get("steps", 0), elapsed)
            used[execution.agent] = used.get(execution.agent, 0.0) + seconds
            self._end_if_due(execution, now)
        for agent, seconds in used.items():
            self._throttle(agent, seconds, elapsed)

    def _end_if_due(self, execution: LocalExecution, now: float) -> None:
        if execution.state == "stopping":
            if now - execution.stopping_since > STOP_SECONDS:
                os.kill(execution.pid, signal.SIGKILL)
        elif now - execution.heard_at > SILENT_SECONDS:
            log.error("execution %s of agent %s hangs and is killed", execution.number, execution.agent)
            os.kill(execution.pid, signal.SIGKILL)
        elif now - execution.used_at > self.idle_seconds:
            self.fleet.stop(execution, "idle")

    def _throttle(self, agent: str, seconds: float, elapsed: float) -> None:
        """Have the agent's executions pause when they used more than its quota: `seconds` of CPU in the `elapsed` ones."""
        pause = self.fleet.buckets[agent].use(seconds, elapsed)
        if pause > 0:
            for execution in self.fleet.population.of_agent(agent):
                execution.tell({"k": "throttle", "seconds": pause})
