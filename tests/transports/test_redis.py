"""The Redis transport keeps the contract, against a real Redis server and a real Celery worker with its prefork children."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from envs_app.execution.saves import MODEL
from envs_app.serving import bond
from envs_app.transports.redis.client import RedisTransport
from shepherd.celery import app
from tests.servers import PROJECT, wait_for
from tests.services import RedisServer, running
from tests.transports.contract import Agent, Engine, TransportContract

START_SECONDS = 240.0
SLOTS = 64  # more than the tests leave running


class RedisEngine(Engine):
    """A worker, and the Redis server through which it is reached."""

    def __init__(self, data: Path, redis: RedisServer, **environment: Any) -> None:
        self.data, self.redis, self.saves = data, redis, data.with_name(f"{data.name}-saves")
        kept = {name: value for name, value in os.environ.items() if not name.startswith("SHEPHERD_")}
        own = {"SHEPHERD_DATA": str(data), "REDIS_URL": redis.url, "SHEPHERD_SLOTS": str(SLOTS)}
        own |= {"SHEPHERD_SAVES": "tests.storages.Pathless"}
        own |= {"SHEPHERD_SAVES_OPTIONS": json.dumps({"location": str(self.saves)})}
        self.environment = kept | own | {name: str(value) for name, value in environment.items()}
        data.mkdir(parents=True, exist_ok=True)
        self.start()

    def start(self) -> None:
        """Start it and wait until it has said that it lives, and executions are launched."""
        with (self.data / "worker.log").open("ab") as log:
            command = [sys.executable, "-I", "-S", bond.__file__, str(os.getpid())]
            command += [sys.executable, "-m", "celery", "-A", "shepherd", "worker", "-Q", "small,large"]
            command += ["--without-mingle", "--without-gossip", "--without-heartbeat"]
            self.process = subprocess.Popen(
                command, cwd=PROJECT, env=self.environment, stdout=log, stderr=log, process_group=0
            )
        wait_for(self._lives, START_SECONDS, "the worker")

    def connect(self) -> RedisTransport:
        return RedisTransport(self.redis.url)

    def signal(self, uid: str, number: int) -> None:
        [pid] = [status["pid"] for status in self.connect().status() if status["uid"] == uid]
        os.kill(pid, number)

    def restart(self, gently: bool) -> None:
        self.stop(signal.SIGTERM if gently else signal.SIGKILL)
        self.start()

    def stop(self, number: int) -> None:
        """End it; its executions end too."""
        children = psutil.Process(self.process.pid).children()
        self.process.send_signal(number)
        self.process.wait(120)
        assert not psutil.wait_procs(children, timeout=90)[1], "executions outlive their worker"

    def _lives(self) -> bool:
        assert self.process.poll() is None, (self.data / "worker.log").read_text()
        room = self.connect().room
        return self.process.pid in [machine["pid"] for machine in room.machines().values()] and room.settled()


@pytest.fixture(scope="module")
def engine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Engine]:
    """One worker for all tests of the contract."""
    with running(RedisServer()) as redis:
        app.conf.broker_url = redis.url  # of this process, which launches executions as a web process does
        worker = RedisEngine(tmp_path_factory.mktemp("redis"), redis)
        yield worker
        worker.stop(signal.SIGTERM)


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
