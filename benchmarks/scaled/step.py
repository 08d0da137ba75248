"""One client whose steps travel through Redis, while PPO trains and between; and the same embedded."""

from __future__ import annotations

from benchmarks.lean import LeanSession
from benchmarks.report import Line, Result
from benchmarks.rig import OBSERVATIONS, ROLLOUT, Player, Timings, make_agent, step_patiently
from benchmarks.scaled.setups import SETUPS
from tests.servers import Server

UPDATES = 4


def run() -> Result:
    """The row: every step of some rollouts and of the updates that follow them."""
    timings = {}
    for name, running in SETUPS.items():
        with running() as server:
            timings[name] = measure(server)
    return Result("scaled.step", lines(timings), {name: timing.summary() for name, timing in timings.items()})


def measure(server: Server) -> Timings:
    """A client that never pauses. Ends in the middle of a rollout, when the last update is over."""
    session = LeanSession(server.url, make_agent(server))
    step_patiently(session, OBSERVATIONS[0])
    player, timings = Player(session), Timings()
    while player.outcomes <= (UPDATES + 0.8) * ROLLOUT:
        timings.run(player.step, 1)
    session.close()
    return timings


def lines(timings: dict[str, Timings]) -> list[Line]:
    """Both, beside the bars of issue 4."""
    scaled = timings["scaled"]
    bars = {"p50": ("< 3 ms", scaled.p50, 3), "p99": ("< 15 ms", scaled.percentile(99), 15)}
    return [
        *(
            Line(f"one client through Redis, {UPDATES} updates of PPO: {name}", f"{value:.2f} ms", bar, value < most)
            for name, (bar, value, most) in bars.items()
        ),
        *(Line(f"the same, {name}", f"{timing}, max {max(timing.ms):.0f} ms") for name, timing in timings.items()),
    ]
