"""The two set-ups that the rows compare: `manage.py serve`, and `manage.py scaled` with a Redis and a PostgreSQL of its own."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

from tests.faults.scaled.setup import Scaled, running_scaled
from tests.servers import Server, running_server

SLOTS = 64  # executions of a worker


def scaled(*parts: str, **environment: Any) -> AbstractContextManager[Scaled]:
    """The scaled-out one; `parts` as `manage.py scaled` takes them."""
    return running_scaled(*parts, **{"SHEPHERD_SLOTS": SLOTS} | environment)


SETUPS: dict[str, Callable[..., AbstractContextManager[Server]]] = {"embedded": running_server, "scaled": scaled}
