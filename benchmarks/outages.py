"""Scaled out: from kill -9 of a part to the next answered step of every client, eight of which step all the while."""

from __future__ import annotations

import os
import signal
import statistics
import threading
import time
from collections.abc import Callable
from typing import Any

import psutil
from shepherd_client import Client

from benchmarks.report import Line, Result
from benchmarks.rig import OBSERVATIONS, make_agent
from envs_app.transports.redis.machines import Room
from envs_app.transports.redis.wire import Wire
from tests.faults.scaled.setup import Scaled, running_scaled
from tests.servers import wait_for
from tests.services import RedisServer

CLIENTS, TIMES, BAR = 8, 3, 2.0
Part = tuple[Callable[[Scaled], Any], Callable[[Any, int], Any]]  # finds it, and kills it


class Stepper(threading.Thread):
    """A client that steps without end, a hundred times a second."""

    def __init__(self, client: Client, ended: threading.Event) -> None:
        super().__init__(daemon=True)
        self.session, self.ended, self.answered = client.session(), ended, [0.0]

    def run(self) -> None:
        """Note when each answer came."""
        number = 0
        while not self.ended.is_set():
            self.session.step(OBSERVATIONS[number % len(OBSERVATIONS)], 1.0, terminated=number % 200 == 199)
            self.answered.append(time.monotonic())
            number += 1
            time.sleep(0.01)

    def pause_after(self, at: float) -> float:
        """Seconds from `at` to the next answer to a step that was not under way before."""
        sent = next(index for index, when in enumerate(self.answered) if when > at)
        return self.answered[sent + 1] - at


def run() -> Result:
    """The row: the longest of all clients, for each part."""
    ended = threading.Event()
    with running_scaled() as server, Client(make_agent(server), server.url, patience=120) as client:
        steppers = [Stepper(client, ended) for _ in range(CLIENTS)]
        for stepper in steppers:
            stepper.start()
        wait_until_steady(server, steppers)
        seconds = {name: [pause(server, steppers, part) for _ in range(TIMES)] for name, part in PARTS.items()}
        ended.set()
        for stepper in steppers:
            stepper.join(60)
    return Result("outages", [line(name, values) for name, values in seconds.items()], {"seconds": seconds})


def pause(server: Scaled, steppers: list[Stepper], part: Part) -> float:
    """Seconds from the kill until all clients had another answer."""
    find, kill = part
    victim = find(server)  # before: it takes a while to find it
    at = time.monotonic()
    kill(victim, signal.SIGKILL)
    wait_until_steady(server, steppers)
    return round(max(stepper.pause_after(at) for stepper in steppers), 3)


def wait_until_steady(server: Scaled, steppers: list[Stepper]) -> None:
    """Until all parts serve, it is known who lives, and every client had twenty more answers.

    For 4.5 s after Redis lost its memory nothing new is launched: who is killed then waits for the rest of that.
    """
    time.sleep(1.0)  # until a death is seen
    room, parts = Room(Wire(server.redis.url)), ("worker1", "worker2")
    wait_for(lambda: {_pid(server, name) for name in parts} <= pids(room), what="the workers")
    wait_for(room.settled, what="all executions to have spoken")
    goals = [len(stepper.answered) + 20 for stepper in steppers]
    wait_for(lambda: all(len(s.answered) >= goal for s, goal in zip(steppers, goals, strict=True)), what="answers")


def pids(room: Room) -> set[int]:
    """Of the workers that say that they live."""
    return {machine["pid"] for machine in room.machines().values()}


def line(name: str, seconds: list[float]) -> Line:
    """A line of the table; a machine is only known to be lost when its executions' leases end."""
    text = f"median {statistics.median(seconds):.2f} s, longest {max(seconds):.2f} s"
    return Line(
        f"scaled out, kill -9 of {name} to the next answered step of every client",
        text,
        f"< {BAR:g} s",
        max(seconds) < BAR,
    )


def _pid(server: Scaled, part: str) -> int:
    """Of a part that runs."""
    pid: int = wait_for(lambda: server.part(part), what=part)
    return pid


def _worker_of_an_execution(server: Scaled) -> int:
    """One of the two may have none. An execution whose worker was killed has some other parent, which must live."""
    parents = {psutil.Process(pid).ppid() for pid in server.execution_pids()}
    return next(pid for pid in (_pid(server, "worker1"), _pid(server, "worker2")) if pid in parents)


def _restart(redis: RedisServer, _: int) -> None:
    redis.kill()
    redis.start()


PARTS: dict[str, Part] = {
    "an execution": (lambda server: server.execution_pids()[0], os.kill),
    "a web process": (lambda server: server.web_pids()[0], os.kill),
    "beat": (lambda server: _pid(server, "beat"), os.killpg),
    "Redis (started again at once)": (lambda server: server.redis, _restart),
    "a worker": (_worker_of_an_execution, os.kill),
    "a machine with a worker": (_worker_of_an_execution, os.killpg),
}
