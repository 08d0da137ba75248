"""A scaled-out set-up to break, and agents to break it with."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tests.faults.conftest import create_agents
from tests.faults.scaled.setup import Scaled, running_scaled

AGENTS: dict[str, dict[str, Any]] = {
    "paused Redis": {},
    "flushed Redis": {},
    "killed Redis": {},
    "full Redis": {},
    "any order": {"sessions_per_execution": 2},
}


@pytest.fixture(scope="package")
def scaled() -> Iterator[Scaled]:
    """The set-up to break; whatever a test did to it, the next one finds it serving."""
    with running_scaled() as server:
        yield server


@pytest.fixture(scope="package")
def scaled_agents(scaled: Scaled) -> dict[str, tuple[str, str]]:
    """Agents of that set-up: id and API key by name."""
    return create_agents(scaled, AGENTS)


@pytest.fixture
def agent(scaled: Scaled, scaled_agents: dict[str, tuple[str, str]]) -> Callable[[str], tuple[str, str]]:
    """An agent by its name, when the set-up is ready for it."""
    scaled.wait_until_ready()
    return scaled_agents.__getitem__
