"""Long updates take turns: as many learners of this machine train at once as it has cores.

A learner that trains holds its interpreter's lock most of the time. With more of them than cores, one that holds its lock is
suspended for the others, and its actor waits for it: sixteen executions on two cores stood still for 2.2 s, taking turns for
under 0.4 s (benchmarks, row `crowd`). The training itself is done as early: the cores are busy either way.

The turns are locks on files, so the kernel gives back the turn of a process that was killed.
"""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import IO

PATIENCE, PAUSE = 60.0, 0.01  # seconds


class Turns:
    """The turns of one learner. Belongs to its thread."""

    def __init__(self, folder: Path, count: int, patience: float = PATIENCE) -> None:
        """`count`: how many may train at once on this machine."""
        self._folder, self._count, self._patience = folder, count, patience
        self._held: IO[str] | None = None

    def take(self, is_ending: Callable[[], bool] = lambda: False) -> bool:
        """Wait for a turn, but not for ever: other agents' updates may take minutes, and this one's clients wait too.

        A folder that cannot be written is no reason to wait. Returns False when it is ending before it has a turn.
        """
        deadline = time.monotonic() + self._patience
        with suppress(OSError):
            while (held := self._try_all()) is None and time.monotonic() < deadline:
                if is_ending():
                    return False
                time.sleep(PAUSE)
            self._held = held
        return True

    def give_back(self) -> None:
        """Let another one train."""
        if self._held is not None:
            self._held.close()  # and so unlocks
            self._held = None

    def _try_all(self) -> IO[str] | None:
        for number in range(self._count):
            file = self._open(number)
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                file.close()
            else:
                return file
        return None

    def _open(self, number: int) -> IO[str]:
        return (self._folder / f"training-{number}.lock").open("w")


def cores() -> int:
    """Of this machine; SHEPHERD_TRAINERS overrules."""
    return int(os.environ.get("SHEPHERD_TRAINERS") or 0) or len(os.sched_getaffinity(0))
