"""The scaled-out set-up to break, in place of the embedded one; agents to break it with are the same."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.faults.conftest import AGENTS, create_agents
from tests.faults.scaled.setup import Scaled, running_scaled


@pytest.fixture(scope="package")
def own() -> Iterator[Scaled]:
    """The set-up to break; whatever a test did to it, the next one finds it serving."""
    with running_scaled() as server:
        yield server


@pytest.fixture(scope="package")
def agents(own: Scaled) -> dict[str, tuple[str, str]]:
    """Agents of that set-up: id and API key by name."""
    return create_agents(own, AGENTS)
