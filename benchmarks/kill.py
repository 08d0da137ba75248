"""From kill -9 of an execution, in the middle of an episode, to the next answered step of its client."""

from __future__ import annotations

import os
import signal
import time

from benchmarks.lean import LeanSession
from benchmarks.report import Line, Result
from benchmarks.rig import OBSERVATIONS, make_agent, step_patiently
from tests.servers import Server, running_server

TIMES = 7


def run() -> Result:
    """The row."""
    with running_server() as server:
        seconds, repeats = measure(server)
    middle, longest = sorted(seconds)[len(seconds) // 2], max(seconds)
    lines = [
        Line("kill -9 of an execution to the next answered step", f"median {middle:.2f} s, longest {longest:.2f} s"),
        Line(
            "how often the client repeated it, in the same session", f"at most {max(repeats)}", "≤ 1", max(repeats) <= 1
        ),
    ]
    return Result("kill", lines, {"seconds": [round(value, 3) for value in seconds], "repeats": repeats})


def measure(server: Server) -> tuple[list[float], list[int]]:
    """Seconds, and repeats, of a client that repeats a refused step by its `seq`, after as long as it was told."""
    seconds, repeats = [], []
    session = LeanSession(server.url, make_agent(server))
    step_patiently(session, OBSERVATIONS[0])
    for _ in range(TIMES):
        for number in range(50):
            session.step(OBSERVATIONS[number], 1.0)
        (victim,) = server.execution_pids()
        os.kill(victim, signal.SIGKILL)
        start = time.perf_counter()
        repeats.append(step_patiently(session, OBSERVATIONS[50]))
        seconds.append(time.perf_counter() - start)
        time.sleep(3)
    return seconds, repeats
