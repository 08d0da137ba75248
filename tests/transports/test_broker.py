"""Celery's connection to Redis."""

from __future__ import annotations

import pytest
from kombu.exceptions import OperationalError

from shepherd.celery import app
from tests.services import free_port


def test_a_worker_that_lost_redis_asks_again_soon() -> None:
    """Nobody listens there: it pauses ever longer, and never for long."""
    pauses: list[float] = []
    with app.connection_for_read(f"redis://127.0.0.1:{free_port()}/0") as broker, pytest.raises(OperationalError):
        broker.clone().ensure_connection(lambda _, pause: pauses.append(pause), max_retries=4)
    assert pauses == pytest.approx([0.1, 0.2, 0.3, 0.4])
    assert broker.LONGEST == 1
