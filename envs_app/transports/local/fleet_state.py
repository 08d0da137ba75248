"""What the parent knows of an execution beside its places: the process, and the socket pair to it."""

from __future__ import annotations

import contextlib
import socket
import time
from dataclasses import dataclass, field

from envs_app.messages import FrameReader, Message, pack
from envs_app.transports.measure import Meter
from envs_app.transports.population import Execution


@dataclass(kw_only=True)
class LocalExecution(Execution):
    """A live child."""

    meter: Meter
    control: socket.socket
    frames: FrameReader = field(default_factory=FrameReader)
    outbox: bytearray = field(default_factory=bytearray)  # told, and not read yet
    used_at: float = field(default_factory=time.monotonic)
    heard_at: float = field(default_factory=time.monotonic)

    @property
    def pid(self) -> int:
        """Its process."""
        return self.meter.pid

    def heed(self, message: Message) -> None:
        """Take over what the child tells of itself."""
        match message["k"]:
            case "ready":
                self.state = "ready"
            case "took":
                self.active.add(message["session"])
                self.reserved.pop(message["session"], None)
                self.homes.add(message["session"])
                self.used_at = time.monotonic()
            case "released":
                self.drop(message["session"])
                self.used_at = time.monotonic()
            case "status":
                self.status = message["status"]
                self.used_at = max(self.used_at, time.monotonic() - message["idle"])
            case "save_answered":
                self.saves_answered = message["ticket"]
            case "published":
                self.published += 1

    def tell(self, message: Message) -> None:
        """Send a control message, now or when the child reads again: one that hangs must not hold the parent up."""
        self.outbox += pack(message)
        self.flush()

    def flush(self) -> None:
        """Send what the child will take; that it is dead is noticed elsewhere."""
        with contextlib.suppress(OSError):
            while self.outbox:
                del self.outbox[: self.control.send(self.outbox, socket.MSG_DONTWAIT)]
