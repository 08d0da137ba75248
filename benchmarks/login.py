"""Logging in, and the first action of a session that needs a new execution."""

from __future__ import annotations

from benchmarks.lean import LeanSession
from benchmarks.report import Line, Result
from benchmarks.rig import Timings, make_agent
from tests.servers import running_server

TIMES = 15


def run() -> Result:
    """The row. Every session stays in the middle of an episode, so that the next one needs an execution of its own."""
    login, first, free = Timings(), Timings(), Timings()
    sessions: list[LeanSession] = []
    with running_server() as server:
        key = make_agent(server)
        for _ in range(TIMES):
            login.run(lambda: sessions.append(LeanSession(server.url, key)), 1)
            first.run(lambda: sessions[-1].step([0.0] * 8), 1)
        sessions.pop().close()  # its execution is free now
        for _ in range(TIMES):
            free.run(lambda: sessions.append(LeanSession(server.url, key)), 1)
            sessions.pop().close()
    both = [a + b for a, b in zip(login.ms, first.ms, strict=True)]
    numbers = {"login": login.ms, "first_step": first.ms, "login_with_a_free_execution": free.ms}
    lines = [
        Line("login, while every execution is busy", _text(login.ms), "< 100 ms", _middle(login.ms) < 100),
        Line("login, while an execution is free", _text(free.ms), "< 100 ms", _middle(free.ms) < 100),
        Line("a new execution: login and the first action together", _text(both), "< 100 ms", _middle(both) < 100),
    ]
    return Result("login", lines, {name: [round(ms, 1) for ms in values] for name, values in numbers.items()})


def _middle(values: list[float]) -> float:
    return sorted(values)[len(values) // 2]


def _text(values: list[float]) -> str:
    return f"median {_middle(values):.0f} ms, longest {max(values):.0f} ms"
