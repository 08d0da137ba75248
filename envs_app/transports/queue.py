"""Who waits for a place in a run's executions: first come, first served, for as long as they keep asking."""

from __future__ import annotations

import time
from collections.abc import Callable

GONE_SECONDS = 5.0  # who has not asked for so long waits no more
FIRST_PAUSE, LONGEST_PAUSE = 0.1, 2.0  # the further behind, the longer until one should ask again
MOST = 100  # who comes when so many wait asks again later: a queue that thousands write to lets nobody through


class Queue:
    """The sessions that were told to come back."""

    def __init__(self, asked: dict[int, float] | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        """`asked`: what another process knows of the queue; `clock`: seconds, the same for all of them."""
        self._asked = asked or {}  # in the order of their coming: when each asked last
        self._clock = clock

    @property
    def asked(self) -> dict[int, float]:
        """For another process: who waits, and when each asked last."""
        return self._asked

    def position(self, session: int) -> int:
        """How many are before the session."""
        now = self._clock()
        self._asked = {other: at for other, at in self._asked.items() if now - at < GONE_SECONDS}
        waiting = list(self._asked)
        return waiting.index(session) if session in self._asked else len(waiting)

    def join(self, session: int) -> float:
        """Wait, or go on waiting, if there is room; returns the seconds until the session should ask again."""
        position = self.position(session)
        if position >= MOST:
            return LONGEST_PAUSE
        pause = FIRST_PAUSE * (position + 1)
        self._asked[session] = self._clock()
        return min(LONGEST_PAUSE, pause)

    def leave(self, session: int) -> None:
        """The session has a place, or wants none."""
        self._asked.pop(session, None)
