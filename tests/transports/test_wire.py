"""Connections to Redis come and go without end, and a server that is away is said to be."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import pytest

from envs_app.transports.redis.wire import Unreachable, Wire
from tests.servers import wait_for
from tests.services import RedisServer, running

pytestmark = pytest.mark.service


def test_connections_are_made_anew_as_often_as_needed() -> None:
    """redis-py's pool counts those that it ever made, and makes a hundred."""
    with running(RedisServer()) as redis:
        wire = Wire(redis.url)
        for _ in range(150):
            wire.connect().disconnect()
        assert wire.ask(("PING",)) == [b"PONG"]


def test_a_server_that_was_away_is_reached_again() -> None:
    with running(RedisServer()) as redis:
        wire = Wire(redis.url)
        assert wire.ask(("SET", "a", "1"), ("GET", "a")) == [b"OK", b"1"]
        redis.kill()
        for _ in range(150):
            with pytest.raises(Unreachable):
                wire.ask(("GET", "a"))
        redis.start()
        assert wire.ask(("GET", "a")) == [None]


def test_a_command_that_is_refused_is_said_to_be_and_the_next_one_is_served() -> None:
    with running(RedisServer()) as redis:
        wire = Wire(redis.url)
        wire.ask(("SET", "a", "1"))
        with pytest.raises(Unreachable):
            wire.ask(("LPUSH", "a", "1"), ("GET", "a"))
        assert wire.ask(("GET", "a")) == [b"1"]


def test_while_a_server_does_not_answer_one_waits_for_it_and_the_others_are_told() -> None:
    with running(RedisServer()) as redis:
        wire = Wire(redis.url)
        redis.pause()
        with pytest.raises(Unreachable):
            wire.ask(("PING",))
        with ThreadPoolExecutor() as threads:
            trial = threads.submit(wire.ask, ("PING",))
            wait_for(wire._trial.locked, what="the trial")
            with pytest.raises(Unreachable):
                wire.ask(("PING",))
            assert trial.running()
            redis.resume()
            assert trial.result(30) == [b"PONG"]
        assert wire.ask(("PING",)) == [b"PONG"]
