"""Redis is paused, flushed, killed, out of memory: steps get 503 while it lasts, and go on by themselves, in their executions."""

from __future__ import annotations

import os
import signal
import time
import urllib.request
from collections.abc import Callable

import pytest

from envs_app.transports.redis.client import RedisTransport
from tests.faults.players import Players, playing, query
from tests.faults.scaled.setup import Scaled
from tests.servers import wait_for

pytestmark = [pytest.mark.service, pytest.mark.long]

Agent = Callable[[str], tuple[str, str]]
PAUSE_SECONDS = 10.0  # as long as a lease


def expect_refusals(players: Players) -> None:
    """All are told to wait, and for how long."""
    before = [len(player.refusals) for player in players]
    wait_for(lambda: all(len(p.refusals) > b for p, b in zip(players, before, strict=True)), what="a refusal of each")
    assert {refusal.status for refusal in players.refused()} == {503}
    assert all(refusal.retry_after for refusal in players.refused())


def expect_workers(own: Scaled) -> None:
    """Both workers say that they live, and watch over their executions: one that is killed is buried."""
    room = RedisTransport(own.redis.url).room
    wait_for(lambda: len(room.machines()) == 2, what="both workers")
    killed = min(own.execution_pids())
    os.kill(killed, signal.SIGKILL)
    wait_for(lambda: "SIGKILL" in last_error(own), what="the death to be noted")


def last_error(own: Scaled) -> str:
    """What went wrong last in an execution, as the administration has it."""
    rows = query(own, "SELECT summary FROM agents_app_executionerror ORDER BY created_at DESC LIMIT 1")
    return rows[0][0] if rows else ""


def test_redis_is_paused(own: Scaled, agent: Agent) -> None:
    with playing(own, agent("killed")[1]) as players:
        own.redis.pause()
        end = time.monotonic() + PAUSE_SECONDS
        expect_refusals(players)
        assert not own.is_ready()
        with urllib.request.urlopen(f"{own.url}healthz", timeout=30) as answer:
            assert answer.status == 200
        time.sleep(max(0.0, end - time.monotonic()))
        own.redis.resume()
        players.play_on(1)


def test_redis_is_flushed(own: Scaled, agent: Agent) -> None:
    """It is told again by those who live; nobody is given a second execution, which would not know its sessions."""
    with playing(own, agent("killed")[1]) as players:
        executions = own.execution_pids()
        for _ in range(2):
            own.redis.command("flushall")
            players.play_on(1)
        assert set(executions) <= set(own.execution_pids())
        assert len(own.execution_pids()) == len(executions)


def test_redis_is_killed_and_comes_back_empty(own: Scaled, agent: Agent) -> None:
    with playing(own, agent("killed")[1]) as players:
        own.redis.kill()
        expect_refusals(players)
        own.redis.start()
        players.play_on(1)
        expect_workers(own)


def test_redis_is_out_of_memory(own: Scaled, agent: Agent) -> None:
    with playing(own, agent("killed")[1]) as players:
        own.redis.command("config", "set", "maxmemory", "1")
        expect_refusals(players)
        own.redis.command("config", "set", "maxmemory", "0")
        players.play_on(1)
        expect_workers(own)
