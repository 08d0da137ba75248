"""The database part of housekeeping, in a thread of the supervisor: the executions' parent never opens a database."""

from __future__ import annotations

import logging
import threading
import time

from django.db import close_old_connections

log = logging.getLogger("shepherd.serve")
INTERVAL, HURRIED_INTERVAL = 1.0, 0.1  # seconds
SAME_ERROR_SECONDS = 60.0  # the same error is logged once in this time


class Housekeeper:
    """Calls envs_app.housekeeping.run_once every second and survives whatever that raises."""

    def __init__(self) -> None:
        self.stopping = threading.Event()
        self.thread = threading.Thread(target=self._loop, name="housekeeping", daemon=True)
        self.interval = INTERVAL
        self.logged: dict[str, float] = {}

    def start(self) -> None:
        """Begin."""
        self.thread.start()

    def hurry(self) -> None:
        """The executions end now, and soon nobody can be asked how."""
        self.interval = HURRIED_INTERVAL

    def stop(self, timeout: float) -> None:
        """End, after the round that is under way."""
        self.stopping.set()
        if self.thread.is_alive():
            self.thread.join(timeout)

    def _loop(self) -> None:
        while not self.stopping.wait(self.interval):
            self.once()

    def once(self) -> None:
        """One round. Errors (a locked database, a parent that restarts) are logged; the next round tries again."""
        from envs_app import housekeeping

        try:
            close_old_connections()
            housekeeping.run_once()
        except Exception as error:
            self._report(error)

    def _report(self, error: Exception) -> None:
        if self.interval == HURRIED_INTERVAL and isinstance(error, OSError):
            return  # the executions' parent has ended, as it shall
        text, now = repr(error), time.monotonic()
        if now - self.logged.get(text, -SAME_ERROR_SECONDS) >= SAME_ERROR_SECONDS:
            self.logged = {text: now}
            log.error("housekeeping failed, and will be tried again", exc_info=error)
