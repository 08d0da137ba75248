"""A history over HTTP: a server of its own, and one client or several that play at the same time."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import gymnasium as gym
from shepherd_client import Client, Session
from shepherd_client.spaces import spaces_of
from shepherd_client.training import play

from agents_app.algorithms.registry import get_row
from benchmarks.histories import Case, Log, Recorder
from tests.servers import Server, running_server


def learn(case: Case, seed: int, clients: int) -> list[list[float]]:
    """The episodes of clients that share one execution. Advice is off: it is another matter."""
    log = Log()
    options = {"advice": "none", "sessions_per_execution": clients, "max_executions": 1}
    with running_server() as server:
        key = make_agent(server, case.environment, case.algorithm, case.parameters | {"seed": seed}, **options)
        play_together(server, key, case.environment, [log] * clients, seed, lambda: log.steps >= case.steps)
        assert len(server.execution_pids()) == 1
    return log.episodes


def make_agent(server: Server, environment: str, algorithm: str, parameters: dict[str, Any], **options: Any) -> str:
    """The API key of a new agent for an environment, without a CPU quota. As SB3 itself: observations are as they are."""
    plain = {"normalize_observations": False} if get_row(algorithm).normalises else {}
    spaces = spaces_of(gym.make(environment))
    return server.create_agent(
        algorithm=algorithm,
        action_space=spaces.action_space,
        observation_space=spaces.observation_space,
        parameters=plain | parameters,
        max_percent_cpu=100_000,
        **options,
    )[1]


def play_together(
    server: Server, key: str, environment: str, logs: list[Log], seed: int, enough: Callable[[], bool]
) -> None:
    """A client per log plays in an environment of its own, until there is enough. Raises RuntimeError when they end before."""
    with Client(key, url=server.url) as client:
        sessions = [client.session() for _ in logs]
        threads = [
            threading.Thread(target=_play, args=(environment, session, log, seed + 1000 * number, enough))
            for number, (session, log) in enumerate(zip(sessions, logs, strict=True))
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    if not enough():
        steps = sum(log.steps for log in set(logs))
        raise RuntimeError(f"{environment}: the clients ended after {steps} steps:\n{server.logged()}")


def _play(environment: str, session: Session, log: Log, seed: int, enough: Callable[[], bool]) -> None:
    env = Recorder(gym.make(environment), log)
    for _ in play(env, session, seed):
        if enough():
            return
