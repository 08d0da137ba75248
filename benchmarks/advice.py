"""What advice adds to a step: three agents on one server, in turns: advised by a peer, advised by nobody, advice off."""

from __future__ import annotations

from benchmarks.lean import LeanSession
from benchmarks.report import Line, Result
from benchmarks.rig import Player, Timings, add_peer, make_agent
from tests.servers import running_server

BLOCK, BLOCKS = 50, 30  # 1500 steps of each: less than a rollout, so that nobody trains meanwhile


def run() -> Result:
    """The row."""
    with running_server() as server:
        keys = {"peer": make_agent(server), "alone": make_agent(server), "off": make_agent(server, advice="none")}
        sessions = {name: LeanSession(server.url, key) for name, key in keys.items()}
        for session in sessions.values():
            session.step([0.0] * 8)
        add_peer(server, keys["peer"])
        players = {name: Player(session) for name, session in sessions.items()}
        timings = {name: Timings() for name in players}
        for _ in range(BLOCKS):
            for name, player in players.items():
                timings[name].run(player.step, BLOCK)
    return Result("advice", lines(timings), {name: timing.summary() for name, timing in timings.items()})


def lines(timings: dict[str, Timings]) -> list[Line]:
    """Differences of medians."""
    added = timings["peer"].p50 - timings["alone"].p50
    whole = timings["peer"].p50 - timings["off"].p50
    medians = ", ".join(f"{name} {timing.p50:.3f}" for name, timing in timings.items())
    return [
        Line("advice of a peer adds, by medians", f"{added:+.3f} ms", "< 0.3 ms", added < 0.3),
        Line(
            "advice of a peer beside advice off", f"{whole:+.3f} ms (medians in ms: {medians})", "< 0.3 ms", whole < 0.3
        ),
    ]
