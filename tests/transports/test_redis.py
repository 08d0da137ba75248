"""The Redis transport keeps the contract, against a real Redis server and a real Celery worker with its prefork children."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from envs_app.execution.saves import MODEL
from envs_app.transports.redis import keys
from envs_app.transports.redis.client import RedisTransport
from shepherd.celery import app
from tests.servers import wait_for
from tests.services import RedisServer, running
from tests.transports.agents import Agent
from tests.transports.contract import TransportContract
from tests.transports.engines import Engine, ProcessEngine

COUNT_THREADS = """
import os, shepherd.celery, numpy
square = numpy.ones((1000, 1000))
square @ square
print(len(os.listdir("/proc/self/task")))
"""
SLOTS = 64  # more than the tests leave running


class RedisEngine(ProcessEngine):
    """A worker, and the Redis server through which it is reached."""

    module = ("celery", "-A", "shepherd", "worker", "-Q", "small,large")
    module += ("--without-mingle", "--without-gossip", "--without-heartbeat")
    start_seconds, stop_seconds = 240.0, 120.0

    def __init__(self, data: Path, redis: RedisServer) -> None:
        self.redis, self.saves = redis, data.with_name(f"{data.name}-saves")
        saves = {"SHEPHERD_SAVES": "tests.storages.Pathless"}
        saves |= {"SHEPHERD_SAVES_OPTIONS": json.dumps({"location": str(self.saves)})}
        super().__init__(data, REDIS_URL=redis.url, SHEPHERD_SLOTS=SLOTS, **saves)

    def connect(self) -> RedisTransport:
        return RedisTransport(self.redis.url)

    def serves(self) -> bool:
        """It has said that it lives, and executions are launched."""
        room = self.connect().room
        return self.process.pid in [machine["pid"] for machine in room.machines().values()] and room.settled()

    @contextmanager
    def hangs(self) -> Iterator[None]:
        """The worker's main process does nothing, as if its machine were lost."""
        self.process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self.process.send_signal(signal.SIGCONT)

    def listeners(self, uid: str) -> int:
        """How many connections say that the execution lives."""
        return self.connect().wire.ask(("PUBSUB", "NUMSUB", keys.alive(uid)))[0][1]


@pytest.fixture(scope="module")
def engine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Engine]:
    """One worker for all tests of the contract."""
    with running(RedisServer()) as redis:
        app.conf.broker_url = redis.url  # of this process, which launches executions as a web process does
        worker = RedisEngine(tmp_path_factory.mktemp("redis"), redis)
        yield worker
        worker.stop()


@pytest.mark.service
class TestRedisTransport(TransportContract):
    """The contract, with saves in a storage that has no paths."""

    def test_acting_goes_on_while_the_storage_of_saves_takes_nothing(self, engine: RedisEngine) -> None:
        """Its folder of the agent is a file, to which not even root can save."""
        agent = Agent(engine, save_interval=32)
        place, player = engine.saves / agent.id, agent.player()
        player.play(64)
        agent.wait_for_event("saved")
        kept = place.rename(place.with_suffix(".kept"))
        place.touch()
        player.play(100)
        assert "could not save" in agent.wait_for_event("error")[0]["summary"]
        place.unlink()
        kept.rename(place)
        known = len(agent.events("saved"))
        player.play(100)
        agent.wait_for_event("saved", known + 1)

    def test_a_killed_execution_is_found_dead_at_once_though_its_worker_says_nothing(self, engine: RedisEngine) -> None:
        """By the first who waits for it; then its place is free."""
        agent = Agent(engine, most=1)
        player = agent.player()
        player.play(3, length=100)
        killed, began = player.address, time.monotonic()
        with engine.hangs():
            engine.signal(killed.uid, signal.SIGKILL)
            with pytest.raises(ConnectionError):
                player.step(reward=1.0)
            assert time.monotonic() - began < keys.LEASE / 3
            assert [event["reason"] for event in agent.events("ended")] == ["lost"]
            assert not agent.status()
        player.address = None
        assert player.end(1.0)["return"] == 3.0
        assert player.address != killed
        assert "SIGKILL" in agent.wait_for_event("error")[0]["summary"]
        assert not agent.transport.shared.load(agent.id).failures[agent.id], (
            "it was ready, and is no failure of its agent"
        )

    def test_an_execution_that_is_taken_for_dead_and_lives_makes_no_mistake(self, engine: RedisEngine) -> None:
        """Its connection is lost while it cannot make another; the step that it has already taken is answered elsewhere."""
        agent = Agent(engine, most=2)
        player = agent.player()
        player.play(4, length=100)
        alive, message = player.address, player.message(reward=1.0)
        pid = agent.status()[alive.uid]["pid"]
        os.kill(pid, signal.SIGSTOP)
        try:
            engine.redis.command("client", "kill", "type", "pubsub")
            with pytest.raises(ConnectionError):
                player.send(message)
            player.address = None
            assert player.send(message)["k"] == "answer"
        finally:
            os.kill(pid, signal.SIGCONT)
        assert player.address != alive
        wait_for(lambda: alive.uid in agent.status(), what="it to say that it lives")
        wait_for(lambda: player.session not in agent.status()[alive.uid]["active_sessions"], what="it to let go")
        player.play(4, length=100)
        assert player.end(1.0) | {"execution": ""} == {
            "number": 1, "return": 9.0, "length": 9, "learning": True, "run": agent.run, "execution": ""
        }  # fmt: skip
        assert player.address != alive
        player.play(1, length=1)
        assert player.step()["k"] == "answer"

    def test_a_connection_that_says_that_an_execution_lives_is_made_again(self, engine: RedisEngine) -> None:
        agent = Agent(engine)
        player = agent.player()
        player.step()
        assert engine.listeners(player.address.uid) == 1
        engine.redis.command("client", "kill", "type", "pubsub")
        wait_for(lambda: engine.listeners(player.address.uid) == 1, what="another")

    def test_saves_lie_where_the_settings_say_and_nowhere_else(self, engine: RedisEngine) -> None:
        agent = Agent(engine)
        agent.player().play(32)
        agent.transport.stop(agent.id, "restart")
        saved, *_ = agent.wait_for_event("saved")
        assert (engine.saves / agent.id / str(agent.run) / saved["name"] / MODEL).is_file()
        assert not (engine.data / "saves").exists()


@pytest.mark.skipif((os.cpu_count() or 1) == 1, reason="with one core there is one thread in any case")
def test_a_worker_multiplies_in_one_thread() -> None:
    command = [sys.executable, "-c", COUNT_THREADS]
    assert subprocess.run(command, check=True, capture_output=True, text=True).stdout == "1\n"
