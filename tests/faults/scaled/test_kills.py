"""kill -9 of any part of the scaled-out set-up, and what embedded survives, too: the same tests."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable

import psutil
import pytest

from envs_app.transports.population import PARENT_GONE
from tests.faults.inside import executions_of
from tests.faults.players import ends, errors_of, one_hangs, playing
from tests.faults.scaled.setup import Scaled
from tests.faults.test_killed_parts import (  # noqa: F401 - run here, too
    test_clients_survive_the_death_of_all_executions_at_once,
    test_learning_goes_on_from_a_save_at_most_one_interval_old,
)
from tests.servers import wait_for

pytestmark = [pytest.mark.service, pytest.mark.long]

Agent = Callable[[str], tuple[str, str]]


def test_clients_survive_the_death_of_a_worker(own: Scaled, agent: Agent) -> None:
    """Its executions hand over, save and end; those of the other worker take over, and another worker is started."""
    identity, key = agent("killed")
    with playing(own, key) as players:
        live = [psutil.Process(execution["pid"]) for execution in executions_of(own, identity)]
        parents = {process.ppid() for process in live}
        part = next(name for name in ("worker1", "worker2") if own.part(name) in parents)
        killed = own.part(part)
        orphans = [process for process in live if process.ppid() == killed]
        os.kill(killed, signal.SIGKILL)
        players.play_on()
        wait_for(lambda: own.part(part) not in (None, killed), what="another worker")
        wait_for(lambda: PARENT_GONE in ends(own, identity).values(), what="the ends to be noted")
        wait_for(lambda: not any(orphan.is_running() for orphan in orphans), 10, "the executions' processes to end")


def test_children_hold_no_connection_of_their_worker(own: Scaled, agent: Agent) -> None:
    """Else Redis would hand tasks to a worker that was killed, for as long as one of its children lives."""
    identity, key = agent("killed")
    with playing(own, key) as players:
        first = {execution["pid"] for execution in executions_of(own, identity)}
        for pid in first:
            os.kill(pid, signal.SIGKILL)
        players.play_on()
        wait_for(lambda: first.isdisjoint(own.execution_pids()), what="other executions")
        for worker in (psutil.Process(own.part(name)) for name in ("worker1", "worker2")):
            wait_for(lambda worker=worker: connections(worker), what="a worker that was started again")
            assert not [child for child in worker.children() if connections(worker) & connections(child)]


def connections(process: psutil.Process) -> set[tuple[str, int]]:
    """Their own ends, which are unlike those of any other connection."""
    return {connection.laddr for connection in process.net_connections("tcp") if connection.raddr}


def test_clients_survive_the_loss_of_a_worker_with_all_its_executions(own: Scaled, agent: Agent) -> None:
    """Nobody is left who could say that they are dead, but that their connections are."""
    with playing(own, agent("killed")[1]) as players:
        os.killpg(own.part("worker2"), signal.SIGKILL)
        players.play_on()


def test_clients_notice_nothing_of_the_death_of_beat(own: Scaled, agent: Agent) -> None:
    """What happens meanwhile is noted when it is back."""
    identity, key = agent("killed")
    with playing(own, key) as players:
        noted = len(errors_of(own, identity))
        killed = own.part("beat")
        os.killpg(killed, signal.SIGKILL)
        os.kill(executions_of(own, identity)[0]["pid"], signal.SIGKILL)
        players.play_on()
        wait_for(lambda: len(errors_of(own, identity)) > noted, what="the death to be noted")
        assert own.part("beat") != killed


def test_a_hung_execution_holds_up_nobody_else(own: Scaled, agent: Agent) -> None:
    with playing(own, agent("killed")[1]) as players:
        with one_hangs(own, players, 2):
            assert own.is_ready()
        players.play_on(1)
