"""Who waits for a place is served in the order of coming, and thousands cost no more than a hundred."""

from __future__ import annotations

import pytest

from envs_app.errors import NoCapacity
from envs_app.transports.population import TELL_SECONDS
from envs_app.transports.queue import FIRST_PAUSE, GONE_SECONDS, LONGEST_PAUSE, MOST, Queue
from envs_app.transports.redis.shared import Fleet, RedisExecution


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_the_further_behind_the_longer_the_pause() -> None:
    queue = Queue(clock=Clock())
    assert [queue.join(session) for session in range(3)] == [FIRST_PAUSE, 2 * FIRST_PAUSE, 3 * FIRST_PAUSE]
    assert [queue.position(session) for session in (0, 2, 9)] == [0, 2, 3]


def test_who_comes_when_very_many_wait_comes_back_and_those_keep_their_turn() -> None:
    clock = Clock()
    queue = Queue(clock=clock)
    for session in range(MOST):
        queue.join(session)
    before = dict(queue.asked)
    assert queue.join(MOST) == LONGEST_PAUSE
    assert queue.asked == before  # nothing to write: thousands may ask
    clock.now += 1
    assert queue.join(MOST - 1) == LONGEST_PAUSE  # it is among them
    assert queue.asked[MOST - 1] == clock.now
    queue.leave(0)
    queue.join(MOST)
    assert queue.position(MOST) == MOST - 1


def test_who_asks_no_more_waits_no_more() -> None:
    clock = Clock()
    queue = Queue(clock=clock)
    queue.join(1)
    clock.now += GONE_SECONDS - 1
    queue.join(2)
    clock.now += 1
    assert queue.position(2) == 0


def test_an_execution_is_told_once_in_a_while_that_others_wait() -> None:
    told = []
    packed = b""
    for at, session in ((100.0, 1), (100.1, 2), (100.1 + TELL_SECONDS, 3)):
        fleet = Fleet("an agent", at)
        fleet.read_decided(packed)
        execution = fleet.by_uid.setdefault(
            "u", RedisExecution(uid="u", number=1, run=1, agent="an agent", sessions_allowed=1)
        )
        execution.launched, execution.reserved = at, {99: at}
        claim = {"session": session, "agent": "an agent", "run": 1, "waits": True}
        with pytest.raises(NoCapacity):
            fleet.find(claim | {"sessions_per_execution": 1, "max_executions": 1}, [])
        told.append([message["k"] for message in execution.outbox])
        packed = fleet.pack()
    assert told == [["crowded"], [], ["crowded"]]
