"""One client's step beside /healthz, in turns on one server: PPO, 8 floats, advice from a live peer, between two updates."""

from __future__ import annotations

import time
from typing import Any

from shepherd_client import Client
from shepherd_client.connection import Address, Connection

from benchmarks.lean import LeanHealth, LeanSession
from benchmarks.report import Line, Result
from benchmarks.rig import Player, Timings, add_peer, last_published, make_agent
from tests.servers import Server, running_server

BLOCK, BLOCKS = 100, 10  # calls; blocks of each kind between two updates: 1000 of the 2048 steps of a rollout
ROUNDS = 3


def run() -> Result:
    """The row."""
    with running_server() as server:
        key = make_agent(server)
        with Client(key, url=server.url) as client:
            lean, package = LeanSession(server.url, key), client.session()
            lean.step([0.0] * 8)
            peer = add_peer(server, key)
            package.step([0.0] * 8)
            timings = measure(server, lean, package)
            lean.close()
            peer.close()
    return Result("step", lines(timings), {name: timing.summary() for name, timing in timings.items()})


def measure(server: Server, lean: LeanSession, package: Any) -> dict[str, Timings]:
    """Blocks of each kind of call in turns, while no execution trains."""
    health, connection = LeanHealth(server.url), Connection(Address.parse(server.url), 30)
    calls = {
        "health": health.ask,
        "step": Player(lean).step,
        "package_health": lambda: connection.request("GET", "/healthz", ""),
        "package_step": Player(package).step,
    }
    timings = {name: Timings() for name in calls}
    for _ in range(ROUNDS):
        for _ in range(BLOCKS):
            for name, call in calls.items():
                timings[name].run(call, BLOCK)
        finish_update(server, [calls["step"], calls["package_step"]])
    health.close()
    return timings


def finish_update(server: Server, steppers: list[Any]) -> None:
    """Step on past the end of the rollout until the execution has trained, each by itself."""
    for step in steppers:
        before = last_published(server)
        while last_published(server) == before:
            step()
        time.sleep(0.3)


def lines(timings: dict[str, Timings]) -> list[Line]:
    """The step, its ratio, and the same with the Python package."""
    step, health = timings["step"], timings["health"]
    ratio, package_ratio = step.rate / health.rate, timings["package_step"].rate / timings["package_health"].rate
    return [
        Line("step, 1 client, PPO, 8 floats, advice on", str(step), "p50 < 2 ms", step.p50 < 2),
        Line(
            "its rate / rate of `/healthz`",
            f"{ratio:.2f} ({step.rate:.0f} / {health.rate:.0f}; by medians {health.p50 / step.p50:.2f})",
            "≥ 0.5",
            ratio >= 0.5,
        ),
        Line(
            "the same with the Python package",
            str(timings["package_step"]),
            "p50 < 2 ms",
            timings["package_step"].p50 < 2,
        ),
        Line("its rate / rate of `/healthz` with the package", f"{package_ratio:.2f}", "≥ 0.5", package_ratio >= 0.5),
    ]
