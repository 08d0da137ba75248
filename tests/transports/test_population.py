"""The rules by which executions are found and launched, where a real transport would take long to get there."""

from __future__ import annotations

from typing import Any

import pytest

from envs_app.errors import NoCapacity
from envs_app.messages import Message
from envs_app.transports.population import IDLE, PARENT_GONE, Execution, Population

CLAIM = {"agent": "a", "run": 1, "session": 7, "max_executions": 1, "sessions_per_execution": 1, "waits": False}


class Deaf(Execution):
    """An execution that is told things."""

    def tell(self, message: Message) -> None:
        pass


def find(**facts: Any) -> Execution | None:
    """What the session is given where the agent has one execution, as the facts say."""
    population = Population[Execution](most=10)
    population.by_uid["u"] = Deaf("u", 1, 1, "a", 1, **facts)
    return population.find(CLAIM, [])


@pytest.mark.parametrize("reason", ["stop", "restart"])
def test_all_wait_while_executions_are_saved(reason: str) -> None:
    with pytest.raises(NoCapacity, match="saved"):
        find(state="stopping", stop_reason=reason)


def test_an_execution_whose_worker_was_killed_holds_nobody_up_and_takes_nobodys_place() -> None:
    assert find(state="stopping", stop_reason=PARENT_GONE) is None, "another may be launched"


def test_an_idle_one_that_is_saved_has_a_place_until_it_has_ended() -> None:
    with pytest.raises(NoCapacity, match="in use"):
        find(state="stopping", stop_reason=IDLE)
