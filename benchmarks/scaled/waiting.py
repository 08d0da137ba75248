"""5,000 open sessions on 64 executions: each is answered within a second, or told when to come back."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import orjson

from benchmarks.lean import LeanSession, Refused, Wire
from benchmarks.report import Line, Result
from benchmarks.rig import OBSERVATIONS, Timings, make_agent
from benchmarks.scaled.setups import SLOTS, scaled

SESSIONS, EXECUTIONS, THREADS = 5000, SLOTS, 8


def run() -> Result:
    """The row: one session per execution, so that most must wait; and sessions that share executions."""
    lines, numbers = [], {}
    with scaled(SHEPHERD_LOGINS=0) as server:
        time.sleep(3)  # a new Redis does not know yet that nobody lives
        for what, places in (("one to an execution", 1), (f"{SESSIONS // EXECUTIONS + 1} to an execution", 79)):
            options = {"max_executions": EXECUTIONS, "sessions_per_execution": places}
            answered, told = play(server.url, make_agent(server, **options))
            longest, outcomes = max(answered.ms + told.ms), len(answered.ms) + len(told.ms)
            text = f"{len(answered.ms)} answered, {len(told.ms)} told when"
            text += f"; p50 {middle(answered, told):.0f} ms, longest {longest:.0f} ms"
            line = Line(f"{SESSIONS} open sessions on {EXECUTIONS} executions, {what}", text, "≤ 1 s each")
            line.holds = longest <= 1000 and outcomes == SESSIONS
            lines.append(line)
            numbers[what] = {"answered": len(answered.ms), "told": len(told.ms), "longest_ms": round(longest)}
    return Result("scaled.waiting", lines, numbers)


def middle(*timings: Timings) -> float:
    """The median of all."""
    together = Timings()
    together.ms = [ms for timing in timings for ms in timing.ms]
    return together.p50


def play(url: str, key: str) -> tuple[Timings, Timings]:
    """All sessions open, then a step of each; the times of those that were answered, and of those that were told to wait."""
    with ThreadPoolExecutor(THREADS) as pool:
        shares = list(pool.map(lambda _: _open(url, key, SESSIONS // THREADS), range(THREADS)))
        outcomes = [outcome for share in pool.map(_step_each, shares) for outcome in share]
    answered, told = Timings(), Timings()
    for was_answered, ms in outcomes:
        (answered if was_answered else told).ms.append(ms)
    return answered, told


def _open(url: str, key: str, count: int) -> list[LeanSession]:
    wire = Wire(url)
    return [LeanSession(url, key, wire) for _ in range(count)]


def _step_each(sessions: list[LeanSession]) -> list[tuple[bool, float]]:
    return [_step(session) for session in sessions]


def _step(session: LeanSession) -> tuple[bool, float]:
    """Whether it was answered, and milliseconds. Raises whatever is neither an answer nor a 503 with a time."""
    start = time.perf_counter()
    try:
        session.step(OBSERVATIONS[0])
    except Refused as refused:
        problem: dict[str, Any] = orjson.loads(refused.body)
        if refused.status != 503 or problem["retry_after"] <= 0:
            raise
        return False, (time.perf_counter() - start) * 1000
    return True, (time.perf_counter() - start) * 1000
