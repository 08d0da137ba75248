"""The executions' side of a transport, running, for tests to break."""

from __future__ import annotations

import os
import subprocess
import sys
from abc import ABC, abstractmethod
from pathlib import Path
from signal import SIGKILL, SIGTERM
from typing import Any

import psutil

from envs_app.serving import bond
from envs_app.transports.base import Transport
from tests.servers import PROJECT, environment_of, wait_for


class Engine(ABC):
    """The executions' side of a transport."""

    @abstractmethod
    def connect(self) -> Transport:
        """A transport of its own, as another web process has one."""

    @abstractmethod
    def signal(self, uid: str, number: int) -> None:
        """Send a signal to an execution."""

    @abstractmethod
    def restart(self, gently: bool) -> None:
        """End everything, after saving or by a kill, and start it again."""


class ProcessEngine(Engine):
    """A process of this machine, and the executions that are its children. It ends when the process of the tests does."""

    module: tuple[str, ...]  # that it runs, and its arguments
    start_seconds: float  # until it serves,
    stop_seconds: float  # until it has saved and ended, and its children too

    def __init__(self, data: Path, **environment: Any) -> None:
        self.data = data
        self.environment = environment_of(data) | {name: str(value) for name, value in environment.items()}
        data.mkdir(parents=True, exist_ok=True)
        self.start()

    @abstractmethod
    def serves(self) -> bool:
        """Whether the process is ready for tests."""

    def start(self) -> None:
        """Start it and wait until it serves."""
        with self.log.open("ab") as log:
            command = [sys.executable, "-I", "-S", bond.__file__, str(os.getpid()), sys.executable, "-m", *self.module]
            self.process = subprocess.Popen(
                command, cwd=PROJECT, env=self.environment, stdout=log, stderr=log, process_group=0
            )
        wait_for(self._lives_and_serves, self.start_seconds, "the executions' side")

    def signal(self, uid: str, number: int) -> None:
        [pid] = [status["pid"] for status in self.connect().status() if status["uid"] == uid]
        os.kill(pid, number)

    def restart(self, gently: bool) -> None:
        self.stop(SIGTERM if gently else SIGKILL)
        self.start()

    def stop(self, number: int = SIGTERM) -> None:
        """End it; its executions end too."""
        children = psutil.Process(self.process.pid).children()
        self.process.send_signal(number)
        self.process.wait(self.stop_seconds)
        assert not psutil.wait_procs(children, timeout=self.stop_seconds)[1], "executions outlive their parent"

    @property
    def log(self) -> Path:
        """What it said."""
        return self.data / "engine.log"

    def _lives_and_serves(self) -> bool:
        assert self.process.poll() is None, self.log.read_text()
        return self.serves()
