"""One client's steps while PPO trains with SB3's defaults: a client that never pauses, and one that pauses 5 ms."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from benchmarks.lean import LeanSession
from benchmarks.report import Line, Result
from benchmarks.rig import ROLLOUT, Player, Timings, add_peer, last_published, make_agent
from tests.servers import Server, running_server

UPDATES = 5


@dataclass
class Stretch:
    """The steps of one client over several updates."""

    timings: Timings
    inside: list[float]  # milliseconds of the steps answered while the execution trained
    update_seconds: list[float]

    @property
    def wall_rate(self) -> float:
        """Steps per second, the client's pauses included."""
        return len(self.timings.ends) / (self.timings.ends[-1] - self.timings.ends[0])

    def summary(self) -> dict[str, object]:
        """For the results."""
        inside = {"p50": np.median(self.inside), "p99": np.percentile(self.inside, 99), "max": max(self.inside)}
        return self.timings.summary() | {
            "inside_ms": {name: round(float(value), 2) for name, value in inside.items()},
            "wall_rate": round(self.wall_rate, 1),
            "inside_steps": len(self.inside),
            "update_seconds": [round(seconds, 2) for seconds in self.update_seconds],
        }


def run() -> Result:
    """The row."""
    stretches = {}
    for name, pause in (("never pauses", 0.0), ("pauses 5 ms", 0.005)):
        with running_server() as server:
            key = make_agent(server)
            session = LeanSession(server.url, key)
            session.step([0.0] * 8)
            peer = add_peer(server, key)
            stretches[name] = measure(server, session, pause)
            peer.close()
    lines = [line for name, stretch in stretches.items() for line in lines_of(name, stretch)]
    return Result("training", lines, {name: stretch.summary() for name, stretch in stretches.items()})


def measure(server: Server, session: LeanSession, pause: float) -> Stretch:
    """Steps over some updates. An update lasts from the rollout's last step to the file of the published policy."""
    timings, player = Timings(), Player(session)
    windows: list[tuple[float, float]] = []
    began: float | None = None
    while len(windows) < UPDATES:
        timings.run(player.step, 1)
        if began is None and player.outcomes > ROLLOUT * (len(windows) + 1):
            began = timings.ends[-1]
        if began is not None and (ended := last_published(server)) > began:
            windows.append((began, ended))
            began = None
        time.sleep(pause)
    inside = [ms for ms, end in zip(timings.ms, timings.ends, strict=True) if _within(end, ms / 1000, windows)]
    return Stretch(timings, inside, [end - begin for begin, end in windows])


def _within(end: float, seconds: float, windows: list[tuple[float, float]]) -> bool:
    return any(end >= begin and end - seconds <= finish for begin, finish in windows)


def lines_of(name: str, stretch: Stretch) -> list[Line]:
    """p99 and the longest of all steps."""
    p99, longest = stretch.timings.percentile(99), max(stretch.timings.ms)
    seconds = np.mean(stretch.update_seconds)
    return [
        Line(f"step while PPO trains, client {name}: p99", f"{p99:.1f} ms", "< 10 ms", p99 < 10),
        Line(f"step while PPO trains, client {name}: max", f"{longest:.0f} ms", "< 50 ms", longest < 50),
        Line(
            f"client {name}: rate; one update; median step meanwhile",
            f"{stretch.wall_rate:.0f}/s; {seconds:.2f} s; {np.median(stretch.inside):.2f} ms",
        ),
    ]
