"""The parent's executions: they are forked, tell what they do, and end."""

from __future__ import annotations

import contextlib
import os
import selectors
import signal
import time
from collections.abc import Callable

from envs_app.messages import Message
from envs_app.transports.local.events import Events
from envs_app.transports.local.fleet_state import LocalExecution
from envs_app.transports.local.forking import fork
from envs_app.transports.local.places import Places
from envs_app.transports.population import Population, why_killed
from envs_app.transports.quota import Bucket

SILENT_SECONDS = 30.0  # one that hangs is killed: its event loop says something every few seconds


class Fleet:
    """All of them, and what happened to them."""

    def __init__(self, places: Places, most: int, selector: selectors.BaseSelector, let_go: Callable[[], None]) -> None:
        """`most`: executions there may be. `let_go`: closes, in a forked execution, what is the parent's alone."""
        self.places, self.selector, self.let_go = places, selector, let_go
        self.population: Population[LocalExecution] = Population(most)
        self.buckets: dict[str, Bucket] = {}  # by agent
        self.events = Events()
        self.stopping = False
        self._by_pid: dict[int, LocalExecution] = {}

    def launch(self, spec: Message) -> LocalExecution:
        """Start an execution."""
        execution = fork(spec, self.places, self.let_go)
        self.population.by_uid[execution.uid] = self._by_pid[execution.pid] = execution
        self.selector.register(execution.control, selectors.EVENT_READ, lambda _: self._hear(execution))
        return execution

    def stop(self, execution: LocalExecution, reason: str) -> None:
        """Have it save and end."""
        if execution.state != "stopping":
            execution.state, execution.stop_reason = "stopping", reason
            execution.stopping_since = time.monotonic()
            execution.tell({"k": "stop", "reason": reason})

    def stop_all(self) -> None:
        """Have all save and end, and start no more."""
        self.stopping = True
        for execution in self.population.by_uid.values():
            self.stop(execution, "stop")

    # --- what they tell ---
    def _hear(self, execution: LocalExecution) -> None:
        try:
            data = execution.control.recv(2**18)
            messages = execution.frames.feed(data)
        except OSError:
            return
        if not data:
            self.reap()
            return
        execution.heard_at = time.monotonic()
        self._hear_all(execution, messages)

    def _hear_all(self, execution: LocalExecution, messages: list[Message]) -> None:
        for message in messages:
            execution.heed(message)
            if message["k"] in ("ready", "published"):
                self._announce_peers(execution.run)
            elif message["k"] in ("error", "saved"):
                self.events.note(execution, **message)

    def _announce_peers(self, run: int) -> None:
        mates = [e for e in self.population.by_uid.values() if e.run == run]
        versions = {e.number: e.published for e in mates if e.published and e.state != "stopping"}
        returns = {e.number: mean for e in mates if (mean := e.status.get("mean_return")) is not None}
        for execution in mates:
            execution.tell({"k": "peers", "versions": versions, "returns": returns})

    # --- how they end ---
    def reap(self) -> None:
        """Bury those that have ended."""
        with contextlib.suppress(ChildProcessError):
            while True:
                pid, status = os.waitpid(-1, os.WNOHANG)
                if pid == 0:
                    return
                self._bury(pid, os.waitstatus_to_exitcode(status))

    def _bury(self, pid: int, code: int) -> None:
        if (execution := self._by_pid.pop(pid, None)) is None:
            return
        with contextlib.suppress(OSError):  # its last words
            execution.control.setblocking(False)
            while data := execution.control.recv(2**16):
                self._hear_all(execution, execution.frames.feed(data))
        self.selector.unregister(execution.control)
        execution.control.close()
        del self.population.by_uid[execution.uid]
        self._remove_files(execution)
        self._note_death(execution, code)
        reason = execution.stop_reason if code == 0 else "crash"
        self.events.note(execution, k="ended", reason=reason or "stop", code=code)
        self._announce_peers(execution.run)

    def _remove_files(self, execution: LocalExecution) -> None:
        weights = self.places.weights(execution.run, execution.number)
        for path in (self.places.execution(execution.uid), weights, weights.with_suffix(".new")):
            path.unlink(missing_ok=True)

    def _note_death(self, execution: LocalExecution, code: int) -> None:
        """One that was killed when it was ready is replaced at once; those that fail by themselves make their agent wait."""
        if code == 0 or execution.stop_reason:
            return
        if code != -signal.SIGKILL or execution.state == "starting":
            self.population.note_failure(execution.agent)
        if code < 0:
            summary = why_killed(code)
            if time.monotonic() - execution.heard_at > SILENT_SECONDS:
                summary = f"the execution hung: it said nothing for {SILENT_SECONDS:g} s, and was killed"
            self.events.note(execution, k="error", summary=summary, traceback="", fatal=True)
