"""The parent of the executions: it imports torch once, and forks an execution in well under a tenth of a second.

Run as `python -m envs_app.transports.local.parent`. It has one thread, no Django, no database and no network; web processes talk
to it through one Unix socket, executions through a socket pair each. DESIGN.md section 3: "An execution is cheap".
"""

from __future__ import annotations

import contextlib
import logging
import os
import selectors
import signal
import socket
import sys
import time
from collections import deque
from typing import Any

from envs_app.errors import NoCapacity, ShepherdError
from envs_app.execution.desk import refusal
from envs_app.messages import FrameReader, Message, pack
from envs_app.transports.local import unix
from envs_app.transports.local.fleet_state import LocalExecution
from envs_app.transports.local.places import Places
from envs_app.transports.measure import Meter
from envs_app.transports.population import Population, why_killed
from envs_app.transports.quota import Bucket
from envs_app.transports.warmth import warm_up

TICK_SECONDS = 0.5
STOP_SECONDS = 15.0  # then an execution is killed
HEARD_SECONDS = 2.0  # the parent outlives its executions for so long, until their ends are written down
SILENT_SECONDS = 30.0  # so is one that hangs: its event loop says something every few seconds
AWAY_SECONDS = 5.0  # without a tick: it was this process that slept, with the machine, say
REPLY_SECONDS = 1.0  # a web process reads its replies at once, or loses its connection
EVENTS_KEPT = 10_000

log = logging.getLogger("shepherd.parent")


class Parent:
    """The event loop."""

    def __init__(self, places: Places, most: int, idle_seconds: float) -> None:
        self.places, self.idle_seconds = places, idle_seconds
        self.population: Population[LocalExecution] = Population(most)
        self.buckets: dict[str, Bucket] = {}  # by agent
        self.selector = selectors.DefaultSelector()
        self.events: deque[dict[str, Any]] = deque(maxlen=EVENTS_KEPT)
        self.event_number = time.time_ns() // 1000  # grows across restarts of the parent
        self.stopping = False
        self.ticked_at = time.monotonic()
        self.by_pid: dict[int, LocalExecution] = {}

    def run(self) -> None:
        """Serve until SIGTERM, then save and end all executions."""
        self.places.parent.parent.mkdir(parents=True, exist_ok=True)
        self._sweep()
        self._watch_signals()
        listener = unix.listen(self.places.parent)
        self.selector.register(listener, selectors.EVENT_READ, self._accept)
        while not (self.stopping and not self.population.by_uid and self._is_heard()):
            for key, _ in self.selector.select(TICK_SECONDS):
                key.data(key.fileobj)
            if time.monotonic() - self.ticked_at >= TICK_SECONDS:
                self._tick()
        self.places.parent.unlink(missing_ok=True)

    def _sweep(self) -> None:
        """Remove what the executions of a killed parent left; those that still live are saving, and serve nobody."""
        folder = self.places.parent.parent
        for stale in (*folder.glob("weights-*"), *folder.glob("*.sock")):
            stale.unlink(missing_ok=True)

    def _is_heard(self) -> bool:
        """Whether the housekeeper has read how the executions ended, or does not ask."""
        return not self.events or time.time() - self.events[-1]["at"] > HEARD_SECONDS

    # --- signals ---
    def _watch_signals(self) -> None:
        reader, writer = socket.socketpair()
        for end in (reader, writer):
            end.setblocking(False)
        signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
        for number in (signal.SIGTERM, signal.SIGCHLD):
            signal.signal(number, lambda *_: None)
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        self._wakeup = writer  # must outlive this call
        self.selector.register(reader, selectors.EVENT_READ, self._on_signals)

    def _on_signals(self, reader: socket.socket) -> None:
        numbers = reader.recv(4096)
        if signal.SIGTERM in numbers:
            self.stopping = True
            for execution in self.population.by_uid.values():
                self._stop(execution, "stop")
        self._reap()

    def _reap(self) -> None:
        with contextlib.suppress(ChildProcessError):
            while True:
                pid, status = os.waitpid(-1, os.WNOHANG)
                if pid == 0:
                    return
                self._bury(pid, os.waitstatus_to_exitcode(status))

    def _bury(self, pid: int, code: int) -> None:
        if (execution := self.by_pid.pop(pid, None)) is None:
            return
        with contextlib.suppress(OSError):  # its last words
            execution.control.setblocking(False)
            while data := execution.control.recv(2**16):
                self._hear_all(execution, execution.frames.feed(data))
        self.selector.unregister(execution.control)
        execution.control.close()
        del self.population.by_uid[execution.uid]
        self.places.execution(execution.uid).unlink(missing_ok=True)
        weights = self.places.weights(execution.run, execution.number)
        for path in (weights, weights.with_suffix(".new")):
            path.unlink(missing_ok=True)
        self._note_death(execution, code)
        reason = execution.stop_reason if code == 0 else "crash"
        self._event(execution, k="ended", reason=reason or "stop", code=code)
        self._announce_peers(execution.run)

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
            self._event(execution, k="error", summary=summary, traceback="", fatal=True)

    # --- what web processes ask ---
    def _accept(self, listener: socket.socket) -> None:
        try:
            connection, _ = listener.accept()
        except OSError as error:
            log.error("no connection can be taken: %s", error)
            time.sleep(0.01)
            return
        connection.settimeout(REPLY_SECONDS)
        reader = FrameReader()
        self.selector.register(connection, selectors.EVENT_READ, lambda sock: self._hear_web(sock, reader))

    def _hear_web(self, connection: socket.socket, reader: FrameReader) -> None:
        try:
            data = connection.recv(2**18)
            messages = reader.feed(data)
        except OSError:
            data, messages = b"", []
        try:
            for message in messages:
                connection.sendall(pack(self._answer(message)))
        except OSError:  # also when half a reply was sent
            data = b""
        if not data:
            self.selector.unregister(connection)
            connection.close()

    def _answer(self, message: Message) -> Message:
        try:
            return getattr(self, f"_do_{message['k']}")(message)
        except ShepherdError as error:
            return refusal(error.code, error.detail, error.retry_after)
        except Exception as error:
            log.exception("the parent could not serve %s", message["k"])
            return refusal("no_capacity", f"the executions' parent failed: {type(error).__name__}", 1.0)

    def _do_ping(self, message: Message) -> Message:
        return {"k": "pong", "pid": os.getpid()}

    def _do_acquire(self, message: Message) -> Message:
        self._refuse_when_stopping()
        execution = self.population.find(message["claim"], message["exclude"])
        if execution is None:
            return {"k": "launch"}
        execution.gives(message["claim"]["session"], time.monotonic())
        return {"k": "execution", "uid": execution.uid}

    def _do_launch(self, message: Message) -> Message:
        self._refuse_when_stopping()
        claim, spec = message["claim"], message["spec"]
        execution = self.population.find(claim, message["exclude"])  # another thread may have launched one meanwhile
        if execution is None:
            self.buckets.setdefault(claim["agent"], Bucket(message["max_percent_cpu"]))
            execution = self._fork(spec)
        execution.gives(claim["session"], time.monotonic())
        return {"k": "execution", "uid": execution.uid}

    def _do_forget(self, message: Message) -> Message:
        for execution in self.population.of_agent(message["agent"]):
            if message["session"] in execution.homes | execution.reserved.keys() | execution.active:
                execution.drop(message["session"])
                execution.homes.discard(message["session"])
                execution.tell({"k": "forget", "session": message["session"]})
        (self.places.ledger / str(int(message["session"]))).unlink(missing_ok=True)
        return {"k": "ok"}

    def _do_status(self, message: Message) -> Message:
        agent, population = message["agent"], self.population
        chosen = population.by_uid.values() if agent is None else population.of_agent(agent)
        return {"k": "status", "executions": [population.describe(e, e.meter.figures()) for e in chosen]}

    def _do_configure(self, message: Message) -> Message:
        settings = message["settings"]
        if percent := settings.get("max_percent_cpu"):
            self.buckets[message["agent"]] = Bucket(percent)
        for execution in self.population.of_agent(message["agent"]):
            execution.tell({"k": "configure", **settings})
        return {"k": "ok"}

    def _do_stop(self, message: Message) -> Message:
        executions = self.population.of_agent(message["agent"])
        self.population.failures.pop(message["agent"], None)
        for execution in executions:
            self._stop(execution, message["reason"])
        return {"k": "ok", "count": len(executions)}

    def _do_save(self, message: Message) -> Message:
        executions = [e for e in self.population.by_uid.values() if e.run == message["run"]]
        for execution in executions:
            execution.saves_asked += 1
            execution.tell({"k": "save", "ticket": execution.saves_asked})
        return {"k": "ok", "count": len(executions)}

    def _do_events(self, message: Message) -> Message:
        while self.events and self.events[0]["id"] <= message["after"]:
            self.events.popleft()
        return {"k": "events", "events": list(self.events)[:500]}

    def _refuse_when_stopping(self) -> None:
        if self.stopping:
            raise NoCapacity("The server is stopping; repeat the step.", 1.0)

    # --- executions ---
    def _fork(self, spec: Message) -> LocalExecution:
        listener = unix.listen(self.places.execution(spec["uid"]))
        ours, theirs = socket.socketpair()
        pid = os.fork()
        if pid == 0:
            ours.close()
            self._become_child(spec, listener, theirs)
        listener.close()
        theirs.close()
        execution = LocalExecution(
            uid=spec["uid"],
            number=spec["number"],
            run=spec["run"],
            agent=spec["agent_id"],
            meter=Meter(pid),
            control=ours,
            sessions_allowed=spec["sessions"],
            reclaim_seconds=spec["reclaim_seconds"],
        )
        self.population.by_uid[execution.uid] = self.by_pid[pid] = execution
        self.selector.register(ours, selectors.EVENT_READ, lambda _: self._hear_execution(execution))
        return execution

    def _become_child(self, spec: Message, listener: socket.socket, control: socket.socket) -> None:
        """In the forked process: let go of what is the parent's, live, and never come back."""
        code = 1
        try:
            parent = os.getppid()
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            for key in list(self.selector.get_map().values()):
                key.fileobj.close()  # type: ignore[union-attr]
            self._wakeup.close()
            self.selector.close()
            from envs_app.transports.local import child

            code = child.main(spec, self.places, listener, control, parent)
        except BaseException:
            log.exception("execution %s could not begin", spec.get("number"))
        finally:
            logging.shutdown()
            os._exit(code)

    def _hear_execution(self, execution: LocalExecution) -> None:
        try:
            data = execution.control.recv(2**18)
            messages = execution.frames.feed(data)
        except OSError:
            return
        if not data:
            self._reap()
            return
        execution.heard_at = time.monotonic()
        self._hear_all(execution, messages)

    def _hear_all(self, execution: LocalExecution, messages: list[Message]) -> None:
        for message in messages:
            match message["k"]:
                case "ready":
                    execution.state = "ready"
                    self._announce_peers(execution.run)
                case "took":
                    execution.active.add(message["session"])
                    execution.reserved.pop(message["session"], None)
                    execution.homes.add(message["session"])
                    execution.used_at = time.monotonic()
                case "released":
                    execution.drop(message["session"])
                    execution.used_at = time.monotonic()
                case "status":
                    execution.status = message["status"]
                    execution.used_at = max(execution.used_at, time.monotonic() - message["idle"])
                case "save_answered":
                    execution.saves_answered = message["ticket"]
                case "published":
                    execution.published += 1
                    self._announce_peers(execution.run)
                case "error" | "saved":
                    self._event(execution, **message)

    def _announce_peers(self, run: int) -> None:
        mates = [e for e in self.population.by_uid.values() if e.run == run]
        versions = {e.number: e.published for e in mates if e.published and e.state != "stopping"}
        returns = {e.number: mean for e in mates if (mean := e.status.get("mean_return")) is not None}
        for execution in mates:
            execution.tell({"k": "peers", "versions": versions, "returns": returns})

    def _stop(self, execution: LocalExecution, reason: str) -> None:
        if execution.state != "stopping":
            execution.state, execution.stop_reason = "stopping", reason
            execution.stopping_since = time.monotonic()
            execution.tell({"k": "stop", "reason": reason})

    def _event(self, execution: LocalExecution, **what: Any) -> None:
        self.event_number = max(self.event_number + 1, time.time_ns() // 1000)
        where = {"uid": execution.uid, "agent": execution.agent, "run": execution.run, "at": time.time()}
        self.events.append({"id": self.event_number, **where, **what})

    # --- housekeeping ---
    def _tick(self) -> None:
        now = time.monotonic()
        elapsed, self.ticked_at = now - self.ticked_at, now
        self._reap()
        if elapsed > AWAY_SECONDS:
            for execution in self.population.by_uid.values():
                execution.heard_at = now
        used: dict[str, float] = {}
        for execution in list(self.population.by_uid.values()):
            execution.flush()
            seconds = execution.meter.update(execution.status.get("steps", 0), elapsed)
            used[execution.agent] = used.get(execution.agent, 0.0) + seconds
            self._end_if_due(execution, now)
        for agent, seconds in used.items():
            pause = self.buckets[agent].use(seconds, elapsed)
            if pause > 0:
                for execution in self.population.of_agent(agent):
                    execution.tell({"k": "throttle", "seconds": pause})

    def _end_if_due(self, execution: LocalExecution, now: float) -> None:
        if execution.state == "stopping":
            if now - execution.stopping_since > STOP_SECONDS:
                os.kill(execution.pid, signal.SIGKILL)
        elif now - execution.heard_at > SILENT_SECONDS:
            log.error("execution %s of agent %s hangs and is killed", execution.number, execution.agent)
            os.kill(execution.pid, signal.SIGKILL)
        elif now - execution.used_at > self.idle_seconds:
            self._stop(execution, "idle")


def main() -> int:
    """Warm up and serve."""
    import warnings

    warnings.filterwarnings("ignore")
    logging.basicConfig(level=os.environ.get("SHEPHERD_LOG_LEVEL", "INFO"), format="%(asctime)s %(name)s %(message)s")
    most = int(os.environ.get("SHEPHERD_MAX_EXECUTIONS") or 500)
    idle = float(os.environ.get("SHEPHERD_IDLE_SECONDS") or 1800)
    import envs_app.transports.local.child  # noqa: F401

    warm_up()
    Parent(Places.from_environment(), most, idle).run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
