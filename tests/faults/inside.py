"""What a test sees of a server from within: its executions, its saves, the weights in them."""

from __future__ import annotations

import zipfile
from io import BytesIO
from typing import Any

import numpy as np
import psutil
import torch as th
from shepherd_client import Session

from envs_app.execution.saves import SaveStore
from envs_app.execution.storage import Folder
from envs_app.transports.base import Transport
from envs_app.transports.local.client import LocalTransport
from envs_app.transports.local.places import Places
from envs_app.transports.redis.client import RedisTransport
from tests.faults.players import query
from tests.servers import Server

HERE = [0.1, -0.2, 0.3, -0.4]  # an observation


def transport(server: Server) -> Transport:
    """The transport of the server's web processes."""
    url = server.environment.get("REDIS_URL")
    return RedisTransport(url) if url else LocalTransport(Places(server.data))


def executions_of(server: Server, agent: str) -> list[dict[str, Any]]:
    """The agent's live executions."""
    return transport(server).status(agent)


def saves_of(server: Server, agent: str) -> SaveStore:
    """The saves of the agent's run."""
    [(run,)] = query(server, "SELECT id FROM agents_app_run WHERE agent_id = ?", agent.replace("-", ""))
    return SaveStore(Folder(Places(server.data).saves), f"{agent}/{run}")


def policy_of(saves: SaveStore) -> dict[str, np.ndarray]:
    """The weights in the newest save, by layer."""
    chosen = saves.choose("latest")
    assert chosen is not None
    with zipfile.ZipFile(chosen.model) as archive:
        weights = th.load(BytesIO(archive.read("policy.pth")), weights_only=True)
    return {layer: tensor.numpy() for layer, tensor in weights.items()}


def play(session: Session, steps: int, episode: int = 20) -> None:
    """Take so many steps, in episodes of this length."""
    for step in range(steps):
        ends = step % episode == episode - 1
        action = np.asarray(session.step(HERE, 1.0, terminated=ends).action, float)
        assert np.isnan(action).all() if ends else np.isfinite(action).all()


def zombies(server: Server) -> list[psutil.Process]:
    """Processes below the supervisor that ended and were not waited for."""
    below = psutil.Process(server.pid).children(recursive=True)
    return [process for process in below if process.status() == psutil.STATUS_ZOMBIE]
