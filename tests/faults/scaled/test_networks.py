"""A worker machine is cut off from all others in the middle of episodes, and comes back: the clients lose nothing."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.faults.conftest import AGENTS, create_agents
from tests.faults.inside import executions_of, transport
from tests.faults.players import playing, query
from tests.faults.scaled.machines import Machine, Network, machines, network
from tests.faults.scaled.setup import Scaled
from tests.servers import wait_for
from tests.services import PostgresServer, RedisServer, running

pytestmark = [pytest.mark.service, pytest.mark.long]

CUT_SECONDS = 20.0  # twice the lease of an execution


@dataclass
class Fleet:
    """Web and beat on this machine, and two machines with workers."""

    server: Scaled
    workers: list[Machine]

    def running(self) -> list[str]:
        """The titles of all executions that have a process, wherever."""
        return [title for worker in self.workers for title in worker.executions()]


@pytest.fixture
def net() -> Iterator[Network]:
    """A network of this test's own."""
    with network() as made:
        yield made


@pytest.fixture
def fleet(net: Network) -> Iterator[Fleet]:
    """The set-up, with Redis and PostgreSQL at the bridge, and one folder of saves that all machines mount."""
    data = Path(tempfile.mkdtemp(prefix="shepherd-"))
    with (
        running(RedisServer("--protected-mode", "no", address=net.address)) as redis,
        running(PostgresServer(address=net.address, network=f"{net.prefix}.0/24")) as postgres,
    ):
        shared = {"SHEPHERD_SECRET_KEY": "x" * 50, "SHEPHERD_SAVES_OPTIONS": f'{{"location": "{data}/saves"}}'}
        server = Scaled(data, redis, postgres, "--workers=0", **shared)
        try:
            server.wait_until_ready()
            with machines(net, 2, server.environment) as workers:
                room = transport(server).room
                wait_for(lambda: len(room.machines()) == 2, 240, "both machines")
                yield Fleet(server, workers)
        finally:
            left = server.end()
            shutil.rmtree(data, ignore_errors=True)
    assert not left


def live_in_redis(fleet: Fleet, agent: str) -> list[int]:
    """The numbers of the executions that say that they live."""
    return sorted(execution["number"] for execution in executions_of(fleet.server, agent))


def live_in_database(fleet: Fleet, agent: str) -> list[int]:
    """The numbers of those that did not end, as the administration has it."""
    sql = "SELECT e.number FROM agents_app_execution AS e JOIN agents_app_run AS run ON run.id = run_id "
    return sorted(row[0] for row in query(fleet.server, f"{sql} WHERE agent_id = ? AND e.ended_at IS NULL", agent))


def agree(fleet: Fleet, agent: str) -> bool:
    """Whether processes, Redis and the database tell of the same executions, each of which there is once."""
    told = live_in_redis(fleet, agent)
    titles = sorted(f"shepherd: execution {number} of {agent}" for number in told)
    return sorted(fleet.running()) == titles and live_in_database(fleet, agent) == told


def each_has_one(fleet: Fleet, agent: str) -> bool:
    """Whether no session is in two executions."""
    sessions = [session for e in executions_of(fleet.server, agent) for session in e["active_sessions"]]
    return len(sessions) == len(set(sessions))


def test_a_machine_is_cut_off_and_comes_back(fleet: Fleet) -> None:
    agent, key = create_agents(fleet.server, {"cut off": AGENTS["killed"]})["cut off"]
    cut_off, other = fleet.workers
    with playing(fleet.server, key) as players:
        wait_for(lambda: cut_off.executions() and other.executions(), what="executions on both machines")
        cut_off.cable.cut()
        began = time.monotonic()
        players.play_on()  # all of them: those of the lost machine elsewhere
        assert time.monotonic() - began < CUT_SECONDS
        assert len(cut_off.executions()) > 0, "they live, and know nothing of it"
        time.sleep(max(0.0, CUT_SECONDS - (time.monotonic() - began)))
        cut_off.cable.mend()
        players.play_on()
        try:
            wait_for(lambda: agree(fleet, agent), 60, "processes, Redis and database to agree")
        except AssertionError as error:
            told = fleet.running(), live_in_redis(fleet, agent), live_in_database(fleet, agent)
            raise AssertionError(f"{error}: {told}\n{cut_off.printed()[-3000:]}") from None
        wait_for(lambda: each_has_one(fleet, agent), 10, "each session to have one execution")
