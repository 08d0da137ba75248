"""Thousands ask for a place and there is none: most are told so without a look at the executions, which costs milliseconds."""

from __future__ import annotations

import time
from collections.abc import Callable

from envs_app.errors import NoCapacity
from envs_app.transports.base import Claim
from envs_app.transports.queue import LONGEST_PAUSE, MOST
from envs_app.transports.redis.shared import Fleet

KEPT_SECONDS = 0.2  # that it is remembered that a queue is full


class Crowds:
    """What one process remembers of full queues, by run: until when, and which sessions have a place or wait for one."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._full: dict[int, tuple[float, frozenset[int]]] = {}

    def note(self, fleet: Fleet, run: int) -> None:
        """Somebody was refused; remember it if the queue has no room either."""
        waiting, now = fleet.queues[run].asked, self._clock()
        if len(waiting) >= MOST:
            placed = (execution.active | execution.reserved.keys() for execution in fleet.by_uid.values())
            lately = {other: full for other, full in self._full.items() if now < full[0]}
            self._full = lately | {run: (now + KEPT_SECONDS, frozenset(waiting).union(*placed))}

    def refuse(self, claim: Claim) -> None:
        """Raises NoCapacity where a look would find that the session cannot even wait."""
        until, known = self._full.get(claim.run, (0.0, frozenset()))
        if self._clock() < until and claim.session not in known:
            raise NoCapacity("All executions of the agent are in use; repeat the step later.", LONGEST_PAUSE)
