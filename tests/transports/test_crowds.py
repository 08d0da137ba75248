"""Who is told without a look that there is no place, and who is not."""

from __future__ import annotations

import pytest

from envs_app.errors import NoCapacity
from envs_app.transports.base import Claim
from envs_app.transports.queue import LONGEST_PAUSE, MOST, Queue
from envs_app.transports.redis.crowds import KEPT_SECONDS, Crowds
from envs_app.transports.redis.shared import Fleet, RedisExecution

RUN, ACTING, PROMISED, WAITING, STRANGER = 1, 1001, 1002, 0, 1003


class Clock:
    """Stands still until it is told."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


def crowded(waiting: int, clock: Clock) -> Crowds:
    """A memory of a fleet with one execution, at which so many wait."""
    fleet, crowds = Fleet("a", 5.0), Crowds(clock)
    execution = RedisExecution(uid="u", number=1, run=RUN, agent="a", sessions_allowed=2)
    execution.active, execution.reserved = {ACTING}, {PROMISED: 5.0}
    fleet.by_uid["u"] = execution
    fleet.queues[RUN] = Queue(dict.fromkeys(range(waiting), 5.0), fleet.clock)
    crowds.note(fleet, RUN)
    return crowds


def claim(session: int, run: int = RUN) -> Claim:
    """Of a session."""
    return Claim("a", run, session, 1, 2)


def test_a_stranger_is_told_to_come_back_while_the_queue_is_full() -> None:
    clock = Clock()
    crowds = crowded(MOST, clock)
    with pytest.raises(NoCapacity) as refused:
        crowds.refuse(claim(STRANGER))
    assert refused.value.retry_after == LONGEST_PAUSE
    clock.now += KEPT_SECONDS
    crowds.refuse(claim(STRANGER))  # nothing is remembered any more


@pytest.mark.parametrize("session", [ACTING, PROMISED, WAITING])
def test_who_has_a_place_or_waits_for_one_is_let_through(session: int) -> None:
    crowded(MOST, Clock()).refuse(claim(session))


def test_another_run_is_not_concerned() -> None:
    crowded(MOST, Clock()).refuse(claim(STRANGER, RUN + 1))


def test_a_queue_with_room_is_looked_at() -> None:
    crowded(MOST - 1, Clock()).refuse(claim(STRANGER))
