"""A server to break, with two web processes, and agents to break it with."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tests.servers import Server, running_server

QUICK = {"n_steps": 32, "batch_size": 32, "n_epochs": 1}  # PPO
OFF_POLICY = {"learning_starts": 50, "batch_size": 16, "net_arch": "16", "learning_rate": 0.0003}
INTERVAL = 200  # steps between saves
MAKE = """
import json
from uuid import uuid4
from agents_app import services
from agents_app.models import APIKey, Algorithm, User
owner = User.objects.create_user(str(uuid4()))  # others may use the server, too
made = {{}}
for name, fields in json.loads({agents!r}).items():
    parameters = fields.pop("parameters")
    fields["algorithm"] = Algorithm.objects.get(name=fields["algorithm"])
    agent = services.create_agent(owner, {{"name": name, **fields}}, parameters)
    made[name] = str(agent.pk), APIKey.issue(agent)[1]
print(json.dumps(made))
"""


def create_agents(server: Server, agents: dict[str, dict[str, Any]]) -> dict[str, tuple[str, str]]:
    """Agents by name, their ids and API keys; made by one command, since each takes a second to start."""
    default = {"algorithm": "PPO", "action_space": 2, "observation_space": [[4], -10, 10], "parameters": QUICK}
    wanted = json.dumps({name: default | {"save_interval": INTERVAL} | fields for name, fields in agents.items()})
    printed = server.make("shell", "-v", "0", "-c", MAKE.format(agents=wanted))
    return {name: (agent, key) for name, (agent, key) in json.loads(printed.splitlines()[-1]).items()}


AGENTS: dict[str, dict[str, Any]] = {
    "killed": {},
    "constant": {"parameters": QUICK | {"learning_rate": 1e-8}},
    "shared": {"sessions_per_execution": 3},
    "playing itself": {"algorithm": "ARS", "parameters": {"n_delta": 2}},
    "other": {},
    "crowded": {"max_executions": 4},
    "full disk": {},
    "unwritable": {},
    "halved": {},
    "refused": {},
    "diverging": {"parameters": QUICK | {"learning_rate": 0.0003}},
    "diverging SAC": {"algorithm": "SAC", "action_space": [[2], -1, 1], "parameters": OFF_POLICY},
    "diverging TD3": {"algorithm": "TD3", "action_space": [[2], -1, 1], "parameters": OFF_POLICY},
    "schedules": {},
    "revoked": {},
    "any order": {"sessions_per_execution": 2},
}


@pytest.fixture(scope="package")
def own() -> Iterator[Server]:
    """The server to break; whatever a test did to it, the next one finds it serving."""
    with running_server(SHEPHERD_WEB_WORKERS=2) as server:
        yield server


@pytest.fixture(scope="package")
def agents(own: Server) -> dict[str, tuple[str, str]]:
    """Agents of that server: id and API key by name."""
    return create_agents(own, AGENTS)


@pytest.fixture
def agent(own: Server, agents: dict[str, tuple[str, str]]) -> Callable[[str], tuple[str, str]]:
    """An agent by its name, when the server is ready for it."""
    own.wait_until_ready()
    return agents.__getitem__
