"""Anything that clients and accidents do to sessions, in any order, on one machine."""

from __future__ import annotations

from collections.abc import Callable

from hypothesis import strategies as st
from hypothesis.stateful import rule

from tests.faults import session_machine
from tests.servers import Server


class Embedded(session_machine.SessionMachine):
    """Here executions have a parent."""

    @rule(which=st.just(0))
    def kill_the_parent(self, which: int) -> None:
        """All executions end with it."""
        self.kill("parent", [pid for pid in [self.server.parent_pid()] if pid], which, most=1)


def test_sessions_are_answered_as_the_model_says(own: Server, agent: Callable[[str], tuple[str, str]]) -> None:
    session_machine.run(Embedded, own, agent("any order")[1], examples=3)
