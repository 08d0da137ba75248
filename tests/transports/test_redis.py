"""The Redis transport keeps the contract, against a real Redis server and a real Celery worker with its prefork children."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from envs_app.execution.saves import MODEL
from envs_app.transports.redis.client import RedisTransport
from shepherd.celery import app
from tests.services import RedisServer, running
from tests.transports.agents import Agent
from tests.transports.contract import TransportContract
from tests.transports.engines import Engine, ProcessEngine

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

    def test_saves_lie_where_the_settings_say_and_nowhere_else(self, engine: RedisEngine) -> None:
        agent = Agent(engine)
        agent.player().play(32)
        agent.transport.stop(agent.id, "restart")
        saved, *_ = agent.wait_for_event("saved")
        assert (engine.saves / agent.id / str(agent.run) / saved["name"] / MODEL).is_file()
        assert not (engine.data / "saves").exists()
