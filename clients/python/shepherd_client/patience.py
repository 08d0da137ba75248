"""How long, and how often, a client repeats a request that was not answered."""

from __future__ import annotations

import logging
import random
import time

from shepherd_client.errors import TransientError

logger = logging.getLogger("shepherd_client")

FIRST_PAUSE, LONGEST_PAUSE = 0.05, 5.0  # seconds; doubled from one to the other
JITTER = 0.5  # pauses are lengthened by up to this share, so that many clients do not come back at once
SOON_TOLD = 1.0  # seconds of waiting after which the user is told why


class Patience:
    """The pauses between the attempts of one request. It ends `seconds` after the first failure."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._least = FIRST_PAUSE
        self._began: float | None = None
        self._told = False

    def wait(self, error: TransientError) -> None:
        """Pause before the next attempt. Raises `error` when that would be past the end."""
        now = time.monotonic()
        if self._began is None:
            self._began = now
        pause = self._next_pause(error)
        waited = now + pause - self._began
        if waited > self._seconds:
            raise error
        if waited > SOON_TOLD and not self._told:
            self._told = True
            logger.warning("%s Trying again for up to %.0f seconds.", error.detail, self._seconds)
        time.sleep(pause)

    def _next_pause(self, error: TransientError) -> float:
        least = self._least if error.retry_after is None else error.retry_after
        self._least = min(2 * self._least, LONGEST_PAUSE)
        return least * (1 + random.uniform(0, JITTER))
