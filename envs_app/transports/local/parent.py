"""The parent of the executions: it imports torch once, and forks an execution in well under a tenth of a second.

Run as `python -m envs_app.transports.local.parent`. It has one thread, no Django, no database and no network; web processes talk
to it through one Unix socket, executions through a socket pair each. DESIGN.md section 3: "An execution is cheap".

parent.py, the event loop ─┬─ answers.py   what web processes ask
                           ├─ watch.py     what it looks after by itself
                           └─ fleet.py     its executions: forking.py begins them, events.py keeps what happens to them
"""

from __future__ import annotations

import logging
import os
import selectors
import signal
import socket
import sys

from envs_app.transports.local import unix
from envs_app.transports.local.answers import Answers
from envs_app.transports.local.fleet import Fleet
from envs_app.transports.local.places import Places
from envs_app.transports.local.watch import TICK_SECONDS, Watch
from envs_app.transports.warmth import warm_up


class Parent:
    """The event loop."""

    def __init__(self, places: Places, most: int, idle_seconds: float) -> None:
        self.places = places
        self.selector = selectors.DefaultSelector()
        self.fleet = Fleet(places, most, self.selector, self._let_go)
        self.answers, self.watch = Answers(self.fleet), Watch(self.fleet, idle_seconds)

    def run(self) -> None:
        """Serve until SIGTERM, then save and end all executions."""
        self.places.parent.parent.mkdir(parents=True, exist_ok=True)
        self._sweep()
        self._watch_signals()
        listener = unix.listen(self.places.parent)
        self.selector.register(listener, selectors.EVENT_READ, self.answers.accept)
        while not self._is_over():
            for key, _ in self.selector.select(TICK_SECONDS):
                key.data(key.fileobj)
            self.watch.tick_if_due()
        self.places.parent.unlink(missing_ok=True)

    def _sweep(self) -> None:
        """Remove what the executions of a killed parent left; those that still live are saving, and serve nobody."""
        folder = self.places.parent.parent
        for stale in (*folder.glob("weights-*"), *folder.glob("*.sock")):
            stale.unlink(missing_ok=True)

    def _is_over(self) -> bool:
        """Whether all executions have ended, and the housekeeper knows how."""
        return self.fleet.stopping and not self.fleet.population.by_uid and self.fleet.events.are_heard()

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
        if signal.SIGTERM in reader.recv(4096):
            self.fleet.stop_all()
        self.fleet.reap()

    def _let_go(self) -> None:
        """In a forked execution: what is the parent's alone."""
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for key in list(self.selector.get_map().values()):
            key.fileobj.close()  # type: ignore[union-attr]
        self._wakeup.close()
        self.selector.close()


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
