"""Signals as items to wait for, so that the supervisor's loop sleeps and still reacts at once."""

from __future__ import annotations

import select
import signal
import socket

STOP = {signal.SIGTERM, signal.SIGINT, signal.SIGHUP}


class Signals:
    """Collects the signals that ask to stop, and wakes up when a child ends."""

    def __init__(self) -> None:
        self.read, self.write = socket.socketpair()
        self.read.setblocking(False)
        self.write.setblocking(False)
        signal.set_wakeup_fd(self.write.fileno(), warn_on_full_buffer=False)
        for number in STOP | {signal.SIGCHLD}:
            signal.signal(number, lambda *_: None)  # the byte on the socket is what counts

    def wait(self, timeout: float) -> bool:
        """Sleep up to `timeout` seconds, or until a signal comes. Whether one of them asks to stop."""
        if not select.select([self.read], [], [], timeout)[0]:
            return False
        return any(signal.Signals(number) in STOP for number in self.read.recv(4096))
