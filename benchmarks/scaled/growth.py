"""How cost grows: with web processes and workers, and with sessions that are mostly idle, as people are."""

from __future__ import annotations

import random
import time
from pathlib import Path
from typing import Any

import psutil

from benchmarks.crowd import run_clients
from benchmarks.lean import LeanSession, Wire
from benchmarks.report import RESULTS, Line, Result
from benchmarks.rig import OBSERVATIONS, Timings, cpu_seconds, make_agent, step_patiently
from benchmarks.scaled.many import memory
from benchmarks.scaled.setups import scaled
from tests.faults.scaled.setup import Scaled

PROCESSES, SESSIONS = (1, 2, 4), (10, 100, 500)
SECONDS, STEPS = 10.0, 1500
SHARED = 50  # sessions of an execution


def run() -> Result:
    """The row."""
    processes = [_with_processes(count) for count in PROCESSES]
    sessions = _with_sessions()
    numbers = {"processes": processes, "sessions": sessions}
    draw(numbers, RESULTS / "scaled.growth.png")
    return Result("scaled.growth", lines(numbers), numbers)


def _with_processes(count: int) -> dict[str, float]:
    """Sixteen clients, learning off, on so many web processes and workers."""
    with scaled(f"--webs={count}", f"--workers={count}") as server:
        key = make_agent(server, enable_learning=False)
        run_clients(server, key, "step", 1.0)  # the executions are there
        before = _used(server)
        load = run_clients(server, key, "step", SECONDS)
        used = _used(server) - before
    facts = {"count": count, "rate": load.rate, "ms_per_step": used / load.calls * 1000, "longest_s": load.longest}
    return {name: round(value, 3) for name, value in facts.items()} | {"errors": len(load.errors)}


def _used(server: Scaled) -> float:
    """Seconds of CPU of the web, the executions and Redis."""
    redis = [server.redis.process.pid] if server.redis.process else []
    return cpu_seconds([*server.web_pids(), *server.execution_pids(), *redis])


def _with_sessions() -> list[dict[str, float]]:
    """More and more open sessions, of which one at a time steps, without a pause."""
    found: list[dict[str, float]] = []
    with scaled() as server:
        key = make_agent(server, sessions_per_execution=SHARED, enable_learning=False)
        wire = Wire(server.url)
        sessions: list[LeanSession] = []
        before = memory(server), _redis_bytes(server)
        for count in SESSIONS:
            while len(sessions) < count:
                sessions.append(LeanSession(server.url, key, wire))
                step_patiently(sessions[-1], OBSERVATIONS[0])
            timings = _step_some(sessions)
            time.sleep(2)
            used = (memory(server) - before[0]) / count, (_redis_bytes(server) - before[1]) / count
            facts = {"count": count, "executions": len(server.execution_pids()), "rate": timings.rate}
            facts |= {"p99_ms": timings.percentile(99), "mb_per_session": used[0], "redis_bytes_per_session": used[1]}
            found.append({name: round(value, 3) for name, value in facts.items()})
    return found


def _step_some(sessions: list[LeanSession]) -> Timings:
    timings, chance = Timings(), random.Random(1)
    for number in range(STEPS):
        timings.run(lambda: chance.choice(sessions).step(OBSERVATIONS[number % 997], 1.0), 1)  # noqa: B023 - called at once
    return timings


def _redis_bytes(server: Scaled) -> int:
    return int(server.redis.command("info", "memory").split("used_memory:")[1].split()[0])


def lines(numbers: dict[str, Any]) -> list[Line]:
    """A line for each point."""
    cores = psutil.cpu_count() or 1
    return [
        *(
            Line(
                f"16 clients, learning off, {it['count']} web processes and workers on {cores} cores",
                f"{it['rate'] / cores:.0f} steps/s per core ({it['rate']:.0f}); {it['ms_per_step']:.2f} ms of CPU a step",
            )
            for it in numbers["processes"]
        ),
        *(
            Line(
                f"{it['count']:.0f} open sessions, {SHARED} to an execution, one steps at a time",
                f"{it['rate']:.0f} steps/s, p99 {it['p99_ms']:.1f} ms; {it['mb_per_session']:.2f} MB and"
                f" {it['redis_bytes_per_session']:.0f} bytes of Redis a session",
            )
            for it in numbers["sessions"]
        ),
        Line("rate with 500 open sessions / with 10", f"{_kept(numbers['sessions']):.2f}"),
        Line("a session more, from 100 to 500 of them", _each_more(*numbers["sessions"][-2:])),
    ]


def _kept(sessions: list[dict[str, float]]) -> float:
    return sessions[-1]["rate"] / sessions[0]["rate"]


def _each_more(few: dict[str, float], many: dict[str, float]) -> str:
    """What it adds; what stands there from the first session on counts no more."""
    names = ("mb_per_session", "redis_bytes_per_session")
    mb, redis = ((many[n] * many["count"] - few[n] * few["count"]) / (many["count"] - few["count"]) for n in names)
    return f"{mb:.2f} MB (its share of an execution too) and {redis:.0f} bytes of Redis"


def draw(numbers: dict[str, Any], path: Path) -> None:
    """Rate over processes; rate, memory and Redis over sessions."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    panels = [
        ("processes", "rate", "web processes and workers", "steps/s, 16 clients"),
        ("sessions", "rate", "open sessions", "steps/s, one at a time"),
        ("sessions", "mb_per_session", "open sessions", "MB per session"),
        ("sessions", "redis_bytes_per_session", "open sessions", "bytes of Redis per session"),
    ]
    figure, axes = plt.subplots(1, len(panels), figsize=(14, 3.2), layout="constrained")
    for axis, (kind, value, across, up) in zip(axes, panels, strict=True):
        axis.plot([it["count"] for it in numbers[kind]], [it[value] for it in numbers[kind]], marker="o")
        axis.set(xlabel=across, ylabel=up, ylim=(0, None))
    figure.savefig(path, dpi=110)
    plt.close(figure)
