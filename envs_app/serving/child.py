"""A process that the supervisor keeps running."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import IO

from envs_app.serving import bond

FIRST_DELAY, LONGEST_DELAY = 0.1, 30.0  # seconds before it is started again; doubles while it keeps dying
STEADY_SECONDS = 10.0  # alive for so long, it counts as well again


class Child:
    """One command, in a process group of its own, so that a Ctrl-C reaches the supervisor only.

    The group is what gets ended: should the process be killed, the processes that it started are ended with it.
    """

    def __init__(
        self, name: str, module: str, arguments: Sequence[str], fds: Sequence[int], log: IO[bytes] | None
    ) -> None:
        self.name, self.module, self.arguments, self.fds, self.log = name, module, arguments, fds, log
        self.process: subprocess.Popen[bytes] | None = None
        self.failures = 0
        self.started = self.start_at = 0.0
        self.orphans: dict[int, float] = {}  # groups whose leader died, and when they are killed

    def start(self, environment: dict[str, str], folder: Path) -> None:
        """Start the process."""
        command = [sys.executable, "-I", "-S", bond.__file__, str(os.getpid())]
        command += [sys.executable, "-m", self.module, *self.arguments]
        self.process = subprocess.Popen(  # noqa: S603 - our own modules
            command,
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=self.log,
            stderr=subprocess.STDOUT if self.log else None,
            pass_fds=self.fds,
            process_group=0,
        )
        self.started = time.monotonic()

    @property
    def pid(self) -> int | None:
        """The number of the running process."""
        return self.process.pid if self.process else None

    def has_died(self) -> int | None:
        """The exit code, once, when the process ended by itself; sets the time of the next start."""
        if self.process is None or (code := self.process.poll()) is None:
            return None
        now = time.monotonic()
        self.failures = 0 if now - self.started > STEADY_SECONDS else self.failures + 1
        self.start_at = now + min(LONGEST_DELAY, FIRST_DELAY * 2**self.failures)
        group, self.process = self.process.pid, None
        if _signal_group(group, signal.SIGTERM):
            self.orphans[group] = now + 20
        return code

    def is_due(self) -> bool:
        """Whether it should be started now."""
        return self.process is None and time.monotonic() >= self.start_at

    def kill_orphans(self, at_once: bool = False) -> None:
        """Kill what is left of groups whose time is over."""
        for group, deadline in list(self.orphans.items()):
            over = at_once or time.monotonic() > deadline
            if not _signal_group(group, signal.SIGKILL if over else 0):
                del self.orphans[group]

    def terminate(self) -> None:
        """Ask the process to end in order."""
        if self.process:
            self.process.terminate()

    def is_gone(self) -> bool:
        """Whether nothing of it is left."""
        self.kill_orphans()
        return not self.orphans and (self.process is None or self.process.poll() is not None)

    def kill(self) -> None:
        """End it and everything that it started, now."""
        if self.process:
            _signal_group(self.process.pid, signal.SIGKILL)
            self.process.wait()
        self.kill_orphans(at_once=True)


def _signal_group(group: int, number: int) -> bool:
    """Send a signal to a process group; whether it had any process."""
    try:
        os.killpg(group, number)
    except ProcessLookupError:
        return False
    return True
