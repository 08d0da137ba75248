"""A curve that is learned by a team in this process; the results look like those over HTTP (experiments/over_http.py)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from agents_app.algorithms.spec import AgentSpec
from experiments.figure import Episodes
from experiments.lockstep.ppo import Settings
from experiments.lockstep.teams import Rules, Teams


@dataclass(frozen=True)
class InLockstep:
    """The settings. `agent`: fields of AgentSpec, such as how its executions advise each other."""

    environment: str
    episodes: int
    clients: int
    parameters: dict[str, Any] = field(default_factory=dict)
    agent: dict[str, Any] = field(default_factory=dict)

    @property
    def advisors(self) -> tuple[str, ...]:
        """None: the learners advise each other."""
        return ()

    def learn(self, seed: int, saves: Path, on_episode: Callable[[], None]) -> list[Episodes]:
        """One run of one team, until the slowest has its episodes; cut to these."""
        return self.learn_together([seed], on_episode)[0]

    def learn_together(self, seeds: list[int], on_episode: Callable[[], None]) -> list[list[Episodes]]:
        """A run for each seed, in half the time. Numbers of one are drawn between those of the others: see Teams."""
        spec = AgentSpec("PPO", 0, 0, **{"advice_method": "intersection"} | self.agent)
        settings = Settings(**self.parameters)
        rules = Rules(self.environment, self.clients, spec.mixing(), spec.advisors, spec.rho, settings, spec.averaging)
        teams = Teams(rules, seeds)
        teams.play(self.episodes, on_episode)
        logs = [log[: self.episodes] for log in teams.episodes]
        return [logs[first : first + self.clients] for first in range(0, len(logs), self.clients)]
