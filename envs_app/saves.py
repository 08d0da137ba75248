"""The saves of runs, where the settings say that they are (STORAGES["saves"])."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from django.core.files.storage import storages

from agents_app.models import Run
from envs_app.execution.saves import SaveStore


def prefix_of(run: Run) -> str:
    """Below which name the saves of a run are."""
    return f"{run.agent_id}/{run.pk}"


@contextmanager
def saves_of(run: Run) -> Iterator[SaveStore]:
    """The saves of a run. Raises ConnectionError as saves_below does."""
    with saves_below(prefix_of(run)) as store:
        yield store


def clear_saves(prefix: str) -> int:
    """Delete all saves there. Returns how many. Raises ConnectionError as saves_below does."""
    with saves_below(prefix) as store:
        names = store.names()
        for name in names:
            store.delete(name)
    return len(names)


@contextmanager
def saves_below(prefix: str) -> Iterator[SaveStore]:
    """The saves there. Raises ConnectionError for whatever the library of the storage raises: it cannot be reached."""
    try:
        yield SaveStore(storages["saves"], prefix)
    except Exception as error:
        raise ConnectionError(f"saves cannot be reached: {error}") from error
