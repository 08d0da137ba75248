"""Algorithms compute on one thread, as in executions; properties are tried on the same examples everywhere."""

from __future__ import annotations

import pytest
import torch as th
from hypothesis import settings

settings.register_profile("shepherd", deadline=None, derandomize=True)
settings.load_profile("shepherd")


@pytest.fixture(scope="session", autouse=True)
def _one_thread() -> None:
    th.set_num_threads(1)
