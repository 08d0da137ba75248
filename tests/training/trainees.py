"""Agents on a live server, trained by real clients over HTTP, and looked at from outside and inside."""

from __future__ import annotations

import io
import json
import threading
import uuid
import zipfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

import httpx
import numpy as np
import torch as th
from shepherd_client import Client, Session
from shepherd_client.spaces import to_wire

from agents_app.spaces import parse_space
from tests.algorithms.specs import small
from tests.faults.inside import transport
from tests.faults.players import errors_of
from tests.servers import Server, wait_for

PATIENCE = 60.0
MAKE = """
import json
from agents_app import services
from agents_app.models import APIKey, Algorithm, User
owner = User.objects.create_user({owner!r})
for name, fields in json.loads({agents!r}).items():
    parameters, algorithm = fields.pop("parameters"), Algorithm.objects.get(name=fields.pop("algorithm"))
    agent = services.create_agent(owner, {{"name": name, "algorithm": algorithm, **fields}}, parameters)
    print(json.dumps([str(agent.pk), APIKey.issue(agent)[1]]))
"""
SERVICES = (
    "from agents_app import services; from agents_app.models import Agent; agent = Agent.objects.get(pk={id!r}); "
)


class Trainee:
    """An agent, its owner's API key, and the machine that it runs on."""

    def __init__(self, server: Server, id: str, key: str, observations: Any) -> None:
        self.server, self.id, self.key = server, id, key
        self.space = parse_space(observations)
        self.space.seed(1)

    # --- its clients ---
    @contextmanager
    def sessions(self, count: int = 1) -> Iterator[list[Session]]:
        """So many clients, each with a session."""
        clients = [Client(self.key, self.server.url, patience=PATIENCE) for _ in range(count)]
        try:
            yield [client.session() for client in clients]
        finally:
            for client in clients:
                client.close()

    def somewhere(self) -> Any:
        """An observation, as JSON has it."""
        return to_wire(self.space, self.space.sample())

    def train(self, clients: int, steps: int, length: int = 10) -> list[float]:
        """Have clients play at the same time; the returns of all their episodes, sorted."""
        with self.sessions(clients) as sessions, ThreadPoolExecutor(clients) as pool:
            returns = pool.map(lambda session: self.play(session, steps, length), sessions)
            return sorted(value for some in returns for value in some)

    def play(self, session: Session, steps: int, length: int = 10, reward: float = 1.0) -> list[float]:
        """So many outcomes in episodes that terminate and are truncated in turn; their returns."""
        returns: list[float] = []
        for _ in range(steps // length):
            session.step(self.somewhere())
            for _ in range(length - 1):
                assert session.step(self.somewhere(), reward).action is not None
            odd = len(returns) % 2 == 1
            reply = session.step(self.somewhere(), reward, terminated=not odd, truncated=odd)
            assert reply.action is None
            assert reply.episode_return is not None
            returns.append(reply.episode_return)
        return returns

    # --- from outside ---
    def get(self, path: str) -> httpx.Response:
        """What the API says to the owner."""
        headers = {"Authorization": f"Bearer {self.key}"}
        return httpx.get(f"{self.server.url}api/v1/agent{path}", headers=headers, timeout=60).raise_for_status()

    def returns(self) -> list[dict[str, Any]]:
        """The returns in the database."""
        return self.get("/returns?limit=10000").json()["results"]

    def policy(self) -> dict[str, np.ndarray]:
        """The weights of the model that one downloads."""
        with zipfile.ZipFile(io.BytesIO(self.get("/model").content)) as archive:
            weights = th.load(io.BytesIO(archive.read("policy.pth")), weights_only=True)
        return {layer: tensor.numpy() for layer, tensor in weights.items()}

    # --- from inside ---
    def status(self) -> list[dict[str, Any]]:
        """The live executions."""
        return transport(self.server).status(self.id)

    def wait_for_status(self, condition: Callable[[dict[str, Any]], Any], executions: int = 1) -> None:
        """Wait until so many live executions have a status of this kind."""
        wait_for(lambda: sum(bool(condition(s)) for s in self.status()) >= executions, PATIENCE, "the status")

    def errors(self) -> list[Any]:
        """What failed in its executions."""
        return errors_of(self.server, self.id)

    def restart(self) -> None:
        """Save and end its executions, and wait for that."""
        before = {status["uid"] for status in self.status()}
        assert transport(self.server).stop(self.id, "restart") == len(before)
        wait_for(lambda: not before & {status["uid"] for status in self.status()}, PATIENCE, "the end")

    def tell(self, what: str) -> None:
        """Run a service, e.g. `services.set_learning(agent, False)`."""
        self.server.manage("shell", "-v", "0", "-c", SERVICES.format(id=self.id) + what)


def make_trainees(server: Server, agents: dict[str, dict[str, Any]]) -> dict[str, Trainee]:
    """Agents by name, made by one command. Their parameters are small ones and those given."""
    full = {name: _fields(fields) for name, fields in agents.items()}
    code = MAKE.format(owner=f"trainer {uuid.uuid4()}", agents=json.dumps(full))
    made = [json.loads(line) for line in server.make("shell", "-v", "0", "-c", code).splitlines()[-len(full) :]]
    spaces = [fields["observation_space"] for fields in full.values()]
    return {
        name: Trainee(server, agent, key, space) for name, (agent, key), space in zip(full, made, spaces, strict=True)
    }


def _fields(fields: dict[str, Any]) -> dict[str, Any]:
    fields = {"algorithm": "PPO", "action_space": 3, "observation_space": 5, "save_interval": 100_000} | fields
    return fields | {"parameters": small(fields["algorithm"]) | fields.get("parameters", {})}


class IdentityGame:
    """A client that is rewarded for doing at `obs` what `obs` says; episodes have 20 steps."""

    def __init__(self, session: Session, states: int) -> None:
        self.session, self.random, self.states = session, np.random.default_rng(1), states

    def play(self, episodes: int) -> list[float]:
        """The share of right actions in each episode."""
        return [self._episode() for _ in range(episodes)]

    def answers(self) -> list[int]:
        """What it does in each state, in an episode of its own."""
        actions = [self.session.step(state).action for state in range(self.states)]
        self.session.step(0, 0.0, truncated=True)
        return actions

    def _episode(self) -> float:
        reward, right = 0.0, 0.0
        for _ in range(20):
            obs = int(self.random.integers(self.states))
            reward = float(self.session.step(obs, reward).action == obs)
            right += reward
        self.session.step(0, reward, terminated=True)
        return right / 20


def at_once(calls: list[Callable[[], Any]]) -> list[Any]:
    """The results of calls that run at the same time, each in a thread of its own, from the same instant."""
    barrier = threading.Barrier(len(calls))

    def run(call: Callable[[], Any]) -> Any:
        barrier.wait(PATIENCE)
        return call()

    with ThreadPoolExecutor(len(calls)) as pool:
        return list(pool.map(run, calls))
