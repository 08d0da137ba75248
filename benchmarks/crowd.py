"""Sixteen clients on one agent, in four processes on this machine, beside the same sixteen on /healthz."""

from __future__ import annotations

import multiprocessing
import statistics
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from benchmarks.lean import LeanHealth, LeanSession
from benchmarks.report import Line, Result
from benchmarks.rig import OBSERVATIONS, Player, cpu_seconds, make_agent, published, step_patiently, wait_until_idle
from tests.servers import Server, running_server

PROCESSES, THREADS = 4, 4
HEALTH_SECONDS, STEP_SECONDS = 6.0, 90.0


@dataclass
class Load:
    """What the clients of one process did, or of all."""

    calls: int = 0
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    longest: float = 0.0  # of one call
    milliseconds: list[float] = field(default_factory=list)  # a sample
    errors: list[str] = field(default_factory=list)

    @property
    def rate(self) -> float:
        """Calls per second."""
        return self.calls / self.seconds

    def summary(self) -> dict[str, Any]:
        """For the results."""
        return {
            "rate": round(self.rate, 1),
            "p50_ms": round(statistics.median(self.milliseconds), 2),
            "p99_ms": round(statistics.quantiles(self.milliseconds, n=100)[98], 2),
            "longest_s": round(self.longest, 3),
            "calls": self.calls,
            "client_cpus": round(self.cpu_seconds / self.seconds, 2),
            "errors": self.errors[:3],
        }


def run() -> Result:
    """The row: learning, and the same with learning off, each between two spells of /healthz."""
    with running_server() as server:
        learning, acting = make_agent(server), make_agent(server, enable_learning=False)
        health = [run_clients(server, learning, "health", HEALTH_SECONDS)]
        watch = Updates(server)
        steps, split = _with_cpu_split(server, learning, STEP_SECONDS)
        updates = watch.stop()
        wait_until_idle(server)
        health.append(run_clients(server, learning, "health", HEALTH_SECONDS))
        idle, idle_split = _with_cpu_split(server, acting, STEP_SECONDS / 5)
        health.append(run_clients(server, learning, "health", HEALTH_SECONDS))
    rate = statistics.mean(load.rate for load in health)
    numbers = {
        "health": [load.summary() for load in health],
        "learning": steps.summary() | split,
        "learning_off": idle.summary() | idle_split,
        "updates": updates,
    }
    return Result("crowd", lines(steps, split, rate, updates) + lines_without_learning(idle, idle_split, rate), numbers)


def _with_cpu_split(server: Server, key: str, seconds: float) -> tuple[Load, dict[str, float]]:
    """Steps of all clients, and the milliseconds of CPU that one took in each part of the system."""
    web = server.web_pids()
    before = cpu_seconds(web), cpu_seconds(server.execution_pids())
    load = run_clients(server, key, "step", seconds)
    wait_until_idle(server)  # what is left to learn belongs to the steps, too
    used = {"clients": load.cpu_seconds, "web": cpu_seconds(web) - before[0]}
    used["executions"] = cpu_seconds(server.execution_pids()) - before[1]
    return load, {f"{name}_cpu_ms_per_step": round(value / load.calls * 1000, 3) for name, value in used.items()}


def lines(steps: Load, split: dict[str, float], health_rate: float, updates: int) -> list[Line]:
    """Rate, ratio, stall."""
    ratio = steps.rate / health_rate
    failed = f", {len(steps.errors)} FAILED: {steps.errors[0]}" if steps.errors else ""
    return [
        Line(
            "16 clients on one agent, all learning: steps/s",
            f"{steps.rate:.0f}/s, p50 {statistics.median(steps.milliseconds):.1f} ms{failed}",
            "≥ 1000/s, machine idle",
            steps.rate >= 1000,
        ),
        Line(
            "its rate / rate of `/healthz` under 16 clients",
            f"{ratio:.2f} ({steps.rate:.0f} / {health_rate:.0f})",
            "≥ 0.5",
            ratio >= 0.5,
        ),
        Line(
            f"longest stall, over {updates} updates of PPO", f"{steps.longest:.2f} s", "≤ 0.4 s", steps.longest <= 0.4
        ),
        Line("CPU of one step, ms", _split_text(split)),
    ]


def lines_without_learning(steps: Load, split: dict[str, float], health_rate: float) -> list[Line]:
    """The same, acting only."""
    text = f"{steps.rate:.0f}/s, {steps.rate / health_rate:.2f} of `/healthz`, longest {steps.longest:.2f} s"
    return [Line("16 clients, learning switched off", text), Line("CPU of one step, ms", _split_text(split))]


def _split_text(split: dict[str, float]) -> str:
    return ", ".join(f"{name.split('_')[0]} {value:.2f}" for name, value in split.items())


class Updates:
    """Counts how often executions publish after they have begun, in a thread."""

    def __init__(self, server: Server) -> None:
        self.server, self.ended = server, threading.Event()
        self.seen: set[tuple[str, float]] = set()
        self.thread = threading.Thread(target=self._watch, daemon=True)
        self.thread.start()

    def stop(self) -> int:
        """How many there were."""
        self.ended.set()
        self.thread.join()
        return len(self.seen) - len({name for name, _ in self.seen})

    def _watch(self) -> None:
        while not self.ended.wait(0.1):
            with suppress(OSError):  # a file was just replaced
                self.seen.update(published(self.server).items())


def run_clients(server: Server, key: str, what: str, seconds: float) -> Load:
    """All clients at once; they begin when all have connected."""
    context = multiprocessing.get_context("spawn")
    barrier, queue = context.Barrier(PROCESSES), context.Queue()
    arguments = (server.url, key, what, seconds, barrier, queue)
    processes = [context.Process(target=_client_process, args=arguments) for _ in range(PROCESSES)]
    for process in processes:
        process.start()
    loads = [queue.get() for _ in processes]
    for process in processes:
        process.join()
    return Load(
        calls=sum(load.calls for load in loads),
        seconds=max(load.seconds for load in loads),
        cpu_seconds=sum(load.cpu_seconds for load in loads),
        longest=max(load.longest for load in loads),
        milliseconds=[ms for load in loads for ms in load.milliseconds],
        errors=[error for load in loads for error in load.errors],
    )


def _client_process(url: str, key: str, what: str, seconds: float, barrier: Any, queue: Any) -> None:
    """Four clients in threads; one process of the load."""
    load = Load()
    callers = [_caller(url, key, what) for _ in range(THREADS)]
    barrier.wait(120)
    start, cpu = time.monotonic(), time.process_time()
    threads = [threading.Thread(target=_repeat, args=(call, start + seconds, load)) for call, _ in callers]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    load.seconds, load.cpu_seconds, load.calls = (
        time.monotonic() - start,
        time.process_time() - cpu,
        len(load.milliseconds),
    )
    load.longest = max(load.milliseconds) / 1000
    load.milliseconds = load.milliseconds[:: max(1, load.calls // 5000)]
    queue.put(load)
    for _, close in callers:
        close()


def _caller(url: str, key: str, what: str) -> tuple[Any, Any]:
    """A call that is ready to be repeated, and what ends it."""
    if what == "health":
        health = LeanHealth(url)
        return health.ask, health.close
    session = LeanSession(url, key)
    step_patiently(session, OBSERVATIONS[0])  # its execution is ready
    return Player(session).step, session.close


def _repeat(call: Any, until: float, load: Load) -> None:
    while (start := time.monotonic()) < until:
        try:
            call()
        except Exception as error:
            load.errors.append(f"{type(error).__name__}: {error}")
            return
        load.milliseconds.append((time.monotonic() - start) * 1000)
