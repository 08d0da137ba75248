"""A curve that is learned through the real server: `manage.py serve`, one PPO agent, a Python client per execution."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.histories import Log
from benchmarks.remote import make_agent, play_together
from experiments.figure import Episodes
from tests.servers import running_server


@dataclass(frozen=True)
class OverHTTP:
    """The settings. `agent`: further options of create_agent, such as how its executions advise each other."""

    environment: str
    episodes: int
    clients: int
    algorithm: str = "PPO"
    parameters: dict[str, Any] = field(default_factory=dict)
    agent: dict[str, Any] = field(default_factory=dict)
    averaging: bool = False  # what the executions learn

    @property
    def advisors(self) -> tuple[str, ...]:
        """None: the executions advise each other."""
        return ()

    def learn(self, seed: int, saves: Path, on_episode: Callable[[], None]) -> list[Episodes]:
        """One run: each client plays on an execution of its own, until the slowest has its episodes; cut to these."""
        logs = [CountedLog(self.episodes, on_episode) for _ in range(self.clients)]
        options = {
            "sessions_per_execution": 1,
            "max_executions": self.clients,
            "averaging": self.averaging,
        } | self.agent
        with running_server() as server:
            key = make_agent(server, self.environment, self.algorithm, self.parameters | {"seed": seed}, **options)
            play_together(server, key, self.environment, list(logs), seed, lambda: all(log.is_full for log in logs))
            assert len(server.execution_pids()) == self.clients
        return [log.episodes[: self.episodes] for log in logs]


class CountedLog(Log):
    """Tells of each episode, as long as they count."""

    def __init__(self, wanted: int, on_episode: Callable[[], None]) -> None:
        super().__init__()
        self.wanted, self.on_episode = wanted, on_episode

    @property
    def is_full(self) -> bool:
        """Whether it has as many episodes as are wanted."""
        return len(self.episodes) >= self.wanted

    def note(self, total: float | None) -> None:
        """A step; with `total`, the end of an episode."""
        if total is not None and not self.is_full:
            self.on_episode()
        super().note(total)
