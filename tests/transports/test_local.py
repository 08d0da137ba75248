"""The local transport keeps the contract, against a real parent process and its forked executions."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from envs_app.errors import NoCapacity
from envs_app.transports.base import Transport
from envs_app.transports.local.client import LocalTransport
from envs_app.transports.local.places import Places
from tests.servers import wait_for
from tests.transports.agents import Agent
from tests.transports.contract import TransportContract
from tests.transports.engines import Engine, ProcessEngine


class LocalEngine(ProcessEngine):
    """A parent process."""

    module = ("envs_app.transports.local.parent",)
    start_seconds, stop_seconds = 90.0, 30.0

    def connect(self) -> LocalTransport:
        return LocalTransport(Places(self.data))

    def serves(self) -> bool:
        try:
            return self.connect().status() == []
        except ConnectionError:
            return False


@pytest.fixture(scope="module")
def engine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Engine]:
    """One parent for all tests of the contract."""
    local = LocalEngine(tmp_path_factory.mktemp("local"))
    yield local
    local.stop()


class TestLocalTransport(TransportContract):
    """The contract."""


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Engine]:
    """A parent that keeps little, and not for long."""
    limits = {"SHEPHERD_MAX_EXECUTIONS": 2, "SHEPHERD_IDLE_SECONDS": 3}
    local = LocalEngine(tmp_path_factory.mktemp("small"), **limits)
    yield local
    local.stop()


class TestLimits:
    """Of the machine, for all agents together."""

    def test_idle_executions_are_saved_and_ended(self, small: Engine) -> None:
        agent = Agent(small)
        player = agent.player()
        player.play(40)
        player.step()
        [ended] = agent.wait_for_event("ended")
        assert ended["reason"] == "idle"
        assert agent.events("saved")
        player.address = None
        assert player.end(2.0)["return"] == 2.0, "its episode goes on"

    def test_one_that_is_used_is_not_idle(self, small: Engine) -> None:
        player = Agent(small).player()
        player.step()
        for _ in range(45):
            assert player.step()["k"] == "answer"
            time.sleep(0.1)

    def test_no_more_executions_than_the_machine_may_have(self, small: Engine) -> None:
        agents = [Agent(small) for _ in range(3)]
        wait_for(lambda: not small.connect().status(), what="the others to end")
        for agent in agents[:2]:
            agent.launch(1)
        with pytest.raises(NoCapacity):
            agents[2].launch(1)


def test_a_parent_that_is_not_there_cannot_be_reached(tmp_path: Path) -> None:
    transport: Transport = LocalTransport(Places(tmp_path))
    with pytest.raises(ConnectionError):
        transport.status()
