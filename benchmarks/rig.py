"""What the rows share: an agent on a server of its own, clients, and timings."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import orjson
import psutil

from benchmarks.lean import LeanSession, Refused
from tests.servers import Server, wait_for

OBSERVATIONS = np.random.default_rng(0).normal(size=(997, 8)).astype(np.float32)
EPISODE = 200  # steps
ROLLOUT = 2048  # SB3's default n_steps of PPO
AGENT: dict[str, Any] = {
    "algorithm": "PPO",
    "action_space": 4,
    "observation_space": [[8], -10, 10],
    "max_percent_cpu": 100_000,  # no quota
    "max_executions": 500,
}


def make_agent(server: Server, **changes: Any) -> str:
    """The API key of a new agent: PPO with SB3's defaults, 8 floats, 4 actions, advice on, no CPU quota."""
    return server.create_agent(**(AGENT | changes))[1]


class Player:
    """A client that plays without end: random observations, a reward of 1, episodes of 200 steps."""

    def __init__(self, session: Any) -> None:
        self.session, self.messages = session, 0

    @property
    def outcomes(self) -> int:
        """Steps that the learner counts, if the session was in an episode at first: all but the first of later ones."""
        return self.messages - (self.messages - 1) // EPISODE

    def step(self) -> None:
        """One step."""
        self.messages += 1
        number = self.messages
        self.session.step(OBSERVATIONS[number % len(OBSERVATIONS)], 1.0, number % EPISODE == 0)


def play(session: Any, steps: int) -> None:
    """Some steps of a new player; it stays in the middle of an episode."""
    player = Player(session)
    for _ in range(steps):
        player.step()


def step_patiently(session: LeanSession, obs: Any) -> int:
    """Step, and repeat what is refused with 503 after as long as is said; how often it had to be repeated."""
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


def add_peer(server: Server, key: str) -> LeanSession:
    """A second execution of the agent, that has learned once and advises from now on. Its session stays silent.

    The agent's first session must be in the middle of an episode, or it would be this one's execution too.
    """
    peer = LeanSession(server.url, key)
    peer.step(OBSERVATIONS[0])
    player = Player(peer)
    while player.outcomes <= ROLLOUT:
        player.step()
    begun = time.time()
    play(peer, 50)
    wait_for(lambda: last_published(server) > begun, 60, "the peer's update")
    time.sleep(0.5)  # until the parent has told the others
    return peer


def published(server: Server) -> dict[str, float]:
    """When each execution published its policy last; each does so when it begins, too."""
    paths = (server.data / "run").glob("weights-*")
    return {path.name: path.stat().st_mtime for path in paths if path.suffix != ".new"}


def last_published(server: Server) -> float:
    """When any execution published last."""
    return max(published(server).values(), default=0.0)


def wait_until_idle(server: Server) -> None:
    """Until the executions use next to no CPU: no backlog, no update."""
    used = -1.0
    while (now := cpu_seconds(server.execution_pids())) - used > 0.05:
        used = now
        time.sleep(1)


def cpu_seconds(pids: list[int]) -> float:
    """What these processes have used so far."""
    return sum(sum(psutil.Process(pid).cpu_times()[:2]) for pid in pids)


class Timings:
    """Milliseconds of many calls."""

    def __init__(self) -> None:
        self.ms: list[float] = []
        self.ends: list[float] = []  # on the clock of time.time()

    def run(self, call: Callable[[], Any], times: int) -> None:
        """Call, and add the times that it took."""
        for _ in range(times):
            start = time.perf_counter()
            call()
            self.ms.append((time.perf_counter() - start) * 1000)
            self.ends.append(time.time())

    def percentile(self, share: float) -> float:
        """E.g. 99: 99 of 100 calls took less."""
        return float(np.percentile(self.ms, share))

    @property
    def p50(self) -> float:
        """The median."""
        return self.percentile(50)

    @property
    def rate(self) -> float:
        """Calls per second."""
        return 1000 / float(np.mean(self.ms))

    def summary(self) -> dict[str, float]:
        """For the results."""
        figures = {"p50_ms": self.p50, "p99_ms": self.percentile(99), "max_ms": max(self.ms), "rate": self.rate}
        return {name: round(value, 3) for name, value in figures.items()} | {"calls": len(self.ms)}

    def __str__(self) -> str:
        return f"p50 {self.p50:.2f} ms, p99 {self.percentile(99):.1f} ms, {self.rate:.0f}/s"
