"""The supervisor: starts the executions' parent and the web processes, restarts what dies, and ends all in order.

manage.py serve ─┬─ executions   envs_app.transports.local.parent, which forks the executions
                 ├─ web          granian, which forks its workers
                 └─ (thread)     housekeeping in the database
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from http.client import HTTPConnection, HTTPException
from pathlib import Path
from typing import TypeVar

from envs_app.serving import preflight
from envs_app.serving.child import Child
from envs_app.serving.housekeeping import Housekeeper
from envs_app.serving.logs import Logs
from envs_app.serving.signals import Signals
from envs_app.transports.local import unix
from envs_app.transports.local.places import Places

T = TypeVar("T")
TICK = 0.2  # seconds
ROTATE_SECONDS = 60.0
START_FAILURES = 4  # deaths of one child before the first request could be answered
EXECUTIONS_GRACE = 30.0  # the executions save


@dataclass(frozen=True)
class Options:
    """How to serve."""

    host: str
    port: int
    data: Path
    project: Path  # the folder of manage.py
    workers: int
    threads: int
    step_timeout: int
    logs: Path | None  # None: standard error


class Supervisor:
    """Runs until it is asked to stop. `say` prints a line for people."""

    def __init__(self, options: Options, say: Callable[[str], None]) -> None:
        self.options, self.say = options, say
        self.places, self.run_folder = Places(options.data), options.data / "run"
        self.lock = preflight.lock(self.run_folder / "serve.lock")
        (self.run_folder / "serve.json").unlink(missing_ok=True)  # of one that was killed
        self.listener = preflight.listen(options.host, options.port)
        self.host, self.port = self.listener.getsockname()[:2]
        self.logs = Logs(options.logs)
        self.web_grace = options.step_timeout + 2
        self.executions, self.web = self._make_executions(), self._make_web()
        self.children = [*self.executions, *self.web]
        self.housekeeper = Housekeeper()
        self.rotated = time.monotonic()
        self.ready = self.forced = False

    def _make_executions(self) -> list[Child]:
        return [self._child("executions", "envs_app.transports.local.parent")]

    def _make_web(self) -> list[Child]:
        return [self._web_child("web")]

    def _web_child(self, name: str) -> Child:
        return self._child(name, "envs_app.serving.web", *self._web_arguments(), fds=[self.listener.fileno()])

    def _child(self, name: str, module: str, *arguments: str, fds: list[int] | None = None) -> Child:
        return Child(name, module, arguments, [self.lock, *(fds or [])], self.logs.open(name))

    def _web_arguments(self) -> list[str]:
        values = {
            "fd": self.listener.fileno(),
            "workers": self.options.workers,
            "threads": self.options.threads,
            "grace": self.web_grace,
        }
        return [word for name, value in values.items() for word in (f"--{name}", str(value))]

    @property
    def url(self) -> str:
        """Where a browser on this machine finds the server."""
        host = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(self.host, self.host)  # noqa: S104 - compared, not bound
        return f"http://{f'[{host}]' if ':' in host and not host.startswith('[') else host}:{self.port}/"

    def run(self, prepare: Callable[[], T], on_ready: Callable[[T], None]) -> None:
        """Serve. `prepare` is called while the parent warms up, and what it returns goes to `on_ready` when the first
        request can be answered. Raises StartError if the start fails.
        """
        signals = Signals()
        try:
            self._before()
            prepared = prepare()
            self._serve(signals, lambda: on_ready(prepared))
        finally:
            self._stop(signals)

    def _before(self) -> None:
        """What may start before the database is ready."""
        for child in self.executions:
            self._start(child)

    def _keep_house(self) -> None:
        self.housekeeper.start()

    def _serve(self, signals: Signals, on_ready: Callable[[], None]) -> None:
        while True:
            self._tend()
            if not self.ready and self._is_ready():
                self.ready = True
                self._write_state()
                on_ready()
                self._keep_house()
            if signals.wait(TICK):
                return

    def _tend(self) -> None:
        """Start what is not running."""
        for child in self.children:
            child.kill_orphans()
            if (code := child.has_died()) is not None:
                self._report_death(child, code)
            if child.is_due():
                self._start(child)
        if time.monotonic() - self.rotated > ROTATE_SECONDS:
            self.rotated = time.monotonic()
            self.logs.rotate()

    def _start(self, child: Child) -> None:
        own = {"SHEPHERD_DATA": str(self.options.data)}
        child.start(os.environ | own, self.options.project)
        self._write_state()

    def _report_death(self, child: Child, code: int) -> None:
        why = f"signal {-code}" if code < 0 else f"exit code {code}"
        if not self.ready and child.failures >= START_FAILURES:
            raise preflight.StartError(f"{child.name} does not start ({why}).\n{self.logs.tail(child.name)}")
        self.say(f"{child.name} ended ({why}) and is started again")

    def _is_ready(self) -> bool:
        """Whether the executions' parent and a web process answer."""
        return self._executions_listen() and self._web_answers()

    def _executions_listen(self) -> bool:
        try:
            unix.connect(self.places.parent, timeout=1).close()
        except OSError:
            return False
        return True

    def _web_answers(self) -> bool:
        connection = HTTPConnection(self.url.split("/")[2], timeout=2)
        try:
            connection.request("GET", "/healthz")
            connection.getresponse()
        except (OSError, HTTPException):
            return False
        finally:
            connection.close()
        return True

    def _write_state(self) -> None:
        """Tell tests and tools where the server is: run/serve.json."""
        state = {"pid": os.getpid(), "host": self.host, "port": self.port, "url": self.url, "ready": self.ready}
        state["processes"] = {child.name: child.pid for child in self.children}
        partial = self.run_folder / "serve.json.new"
        partial.write_text(json.dumps(state))
        partial.rename(self.run_folder / "serve.json")

    def _stop(self, signals: Signals) -> None:
        """End the web first, so that running requests are answered; then the executions, which save."""
        self.listener.close()
        self._end(self.web, self.web_grace + 5, signals)
        self.housekeeper.hurry()
        self._end(self.executions, EXECUTIONS_GRACE, signals)
        self.housekeeper.stop(timeout=10)
        (self.run_folder / "serve.json").unlink(missing_ok=True)

    def _end(self, children: list[Child], grace: float, signals: Signals) -> None:
        """End children: in order, or at once when time is up. A second signal ends all at once."""
        for child in children:
            child.terminate()
        deadline = time.monotonic() + grace
        while not self.forced and not all(child.is_gone() for child in children) and time.monotonic() < deadline:
            if signals.wait(TICK):
                self.forced = True
                self.say("ending at once")
        for child in children:
            child.kill()
