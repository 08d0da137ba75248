"""A new version is rolled out while sixteen clients step: each part is ended in order, and started again."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable

import pytest

from tests.faults.inside import saves_of, transport
from tests.faults.players import ends, playing
from tests.faults.scaled.setup import Scaled
from tests.servers import wait_for

pytestmark = [pytest.mark.service, pytest.mark.long]

Agent = Callable[[str], tuple[str, str]]


def end(own: Scaled, part: str, number: int) -> None:
    """Send a signal to a part, and wait until the next one serves."""
    ended = own.part(part)
    os.kill(ended, number)
    wait_for(lambda: own.part(part) not in (None, ended), what=f"another {part}")
    if part.startswith("worker"):
        wait_for(lambda: own.part(part) in workers(own), what=f"{part} to say that it lives")


def workers(own: Scaled) -> list[int]:
    """The process ids of those that say that they live."""
    return [machine["pid"] for machine in transport(own).room.machines().values()]


def test_a_rolling_restart(own: Scaled, agent: Agent) -> None:
    """Executions save and hand over; nobody hears an error that the client package does not hide."""
    identity, key = agent("other")
    with playing(own, key, clients=16) as players:
        players.play_on()
        before = {uid for uid, reason in ends(own, identity).items() if not reason}
        for part in ("web1", "worker1", "web2", "worker2", "beat"):
            end(own, part, signal.SIGTERM)
            players.play_on(1)
        wait_for(lambda: all(ends(own, identity)[uid] for uid in before), what="the ends to be noted")
        assert {ends(own, identity)[uid] for uid in before} == {"stop"}
        assert saves_of(own, identity).choose("latest") is not None


def test_a_worker_that_is_told_to_end_at_once(own: Scaled, agent: Agent) -> None:
    with playing(own, agent("killed")[1]) as players:
        os.kill(own.part("worker1"), signal.SIGQUIT)
        players.play_on()
