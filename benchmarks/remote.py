"""A history over HTTP: a server of its own, and one client or several that share one execution."""

from __future__ import annotations

import threading

import gymnasium as gym
from shepherd_client import Client, Session
from shepherd_client.spaces import spaces_of
from shepherd_client.training import play

from benchmarks.histories import Case, Log, Recorder
from tests.servers import Server, running_server


def learn(case: Case, seed: int, clients: int) -> list[list[float]]:
    """The episodes. Advice is off: it is another matter."""
    log = Log()
    with running_server() as server:
        key = _agent(server, case, seed, clients)
        with Client(key, url=server.url) as client:
            sessions = [client.session() for _ in range(clients)]
            threads = [
                threading.Thread(target=_play, args=(case, session, log, seed + 1000 * number))
                for number, session in enumerate(sessions)
            ]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            if log.steps < case.steps:
                raise RuntimeError(f"{case.name}: the clients ended after {log.steps} steps:\n{server.logged()}")
            assert len(server.execution_pids()) == 1
    return log.episodes


def _agent(server: Server, case: Case, seed: int, clients: int) -> str:
    env = gym.make(case.environment)
    spaces = spaces_of(env)
    return server.create_agent(
        algorithm=case.algorithm,
        action_space=spaces.action_space,
        observation_space=spaces.observation_space,
        parameters=case.parameters | {"seed": seed},
        advice="none",
        sessions_per_execution=clients,
        max_executions=1,
        max_percent_cpu=100_000,
    )[1]


def _play(case: Case, session: Session, log: Log, seed: int) -> None:
    env = Recorder(gym.make(case.environment), log)
    for _ in play(env, session, seed):
        if log.steps >= case.steps:
            return
