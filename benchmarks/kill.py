"""From kill -9 of an execution, in the middle of an episode, to the next answered step of its client."""

from __future__ import annotations

import os
import signal
import time
from typing import Any

import orjson

from benchmarks.lean import LeanSession, Refused
from benchmarks.report import Line, Result
from benchmarks.rig import OBSERVATIONS, make_agent
from tests.servers import running_server

TIMES = 7


def run() -> Result:
    """The row: a client that repeats a refused step by its `seq`, after as long as it was told."""
    seconds, repeats = [], []
    with running_server() as server:
        session = LeanSession(server.url, make_agent(server))
        for _ in range(TIMES):
            for number in range(50):
                session.step(OBSERVATIONS[number], 1.0)
            (victim,) = server.execution_pids()
            os.kill(victim, signal.SIGKILL)
            start = time.perf_counter()
            repeats.append(_step_patiently(session, OBSERVATIONS[50]))
            seconds.append(time.perf_counter() - start)
            time.sleep(3)
    middle, longest = sorted(seconds)[len(seconds) // 2], max(seconds)
    lines = [
        Line("kill -9 of an execution to the next answered step", f"median {middle:.2f} s, longest {longest:.2f} s"),
        Line(
            "how often the client repeated it, in the same session", f"at most {max(repeats)}", "≤ 1", max(repeats) <= 1
        ),
    ]
    return Result("kill", lines, {"seconds": [round(value, 3) for value in seconds], "repeats": repeats})


def _step_patiently(session: LeanSession, obs: Any) -> int:
    """Step; how often it had to be repeated."""
    for repeats in range(100):
        try:
            session.step(obs, 1.0)
        except Refused as refused:
            if refused.status != 503:
                raise
            session.seq -= 1
            time.sleep(orjson.loads(refused.body)["retry_after"])
        else:
            return repeats
    raise RuntimeError("the step was refused a hundred times")
