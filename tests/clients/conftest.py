"""Agents for the clients to train."""

from __future__ import annotations

import pytest

from tests.servers import Server

CAMERA = [[40, 40, 3], 0, 255]


@pytest.fixture(scope="session")
def keys(server: Server) -> dict[str, str]:
    """API keys of agents with different spaces."""
    mixed = {"camera": CAMERA, "speed": [[1], 0, 10]}
    spaces = {"vector": (2, [[4], -10, 10]), "image": (3, CAMERA), "mixed": ([[2], -1, 1], mixed)}
    return {
        name: server.create_agent(name=f"clients: {name}", action_space=action, observation_space=observation)[1]
        for name, (action, observation) in spaces.items()
    }
