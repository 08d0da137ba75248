"""Anything that clients and accidents do to sessions, in any order, scaled out."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import rule

from tests.faults import session_machine
from tests.faults.scaled.setup import Scaled


class ScaledOut(session_machine.SessionMachine):
    """Here executions have workers, and Redis in between."""

    server: Scaled

    @rule(which=st.integers(0, 1))
    def kill_a_worker(self, which: int) -> None:
        """Its executions end with it."""
        self.kill("worker", [pid for pid in map(self.server.part, ("worker1", "worker2")) if pid], which, most=1)


@pytest.mark.service
def test_sessions_are_answered_as_the_model_says(own: Scaled, agent: Callable[[str], tuple[str, str]]) -> None:
    session_machine.run(ScaledOut, own, agent("any order")[1], examples=2)
