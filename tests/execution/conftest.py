"""Executions compute on one thread, as the parent has them."""

from __future__ import annotations

import pytest
import torch as th


@pytest.fixture(scope="session", autouse=True)
def _one_thread() -> None:
    th.set_num_threads(1)
