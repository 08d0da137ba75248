"""What happened to executions, kept until the housekeeper has written it down."""

from __future__ import annotations

import time
from collections import deque
from typing import Any

from envs_app.transports.population import Execution

HEARD_SECONDS = 2.0  # the parent outlives its executions for so long, until their ends are written down
KEPT = 10_000
AT_ONCE = 500


class Events:
    """Numbered in the order in which they happened."""

    def __init__(self) -> None:
        self._kept: deque[dict[str, Any]] = deque(maxlen=KEPT)
        self._number = time.time_ns() // 1000  # grows across restarts of the parent

    def note(self, execution: Execution, **what: Any) -> None:
        """Something happened to the execution."""
        self._number = max(self._number + 1, time.time_ns() // 1000)
        where = {"uid": execution.uid, "agent": execution.agent, "run": execution.run, "at": time.time()}
        self._kept.append({"id": self._number, **where, **what})

    def after(self, number: int) -> list[dict[str, Any]]:
        """The next ones; who asks has written those down until this number."""
        while self._kept and self._kept[0]["id"] <= number:
            self._kept.popleft()
        return list(self._kept)[:AT_ONCE]

    def are_heard(self) -> bool:
        """Whether all have been written down, or nobody asks."""
        return not self._kept or time.time() - self._kept[-1]["at"] > HEARD_SECONDS
