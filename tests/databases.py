"""Commands of manage.py on the database of a running server, in this process: 20 ms, where a process of their own takes 1.5 s."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, redirect_stdout
from pathlib import Path

import dj_database_url
from django.apps import apps
from django.core.management import call_command
from django.db import connections
from django.db.utils import ConnectionHandler

# In tests pytest-django refuses every database but its own; conftest.py puts in here what lifts that.
unblocked: Callable[[], AbstractContextManager[None]] = nullcontext


def can_call() -> bool:
    """Whether this process has Django, as tests have and benchmarks have not."""
    return apps.ready


def call(url: str, *arguments: str) -> str:
    """What `manage.py` prints for these arguments, with `url` as DATABASE_URL. Raises CommandError when it fails.

    The other settings are those of this process: nothing that speaks to executions belongs here.
    """
    printed = io.StringIO()
    with unblocked(), _default_database(url), redirect_stdout(printed):
        call_command(*arguments, stdout=printed)
    return printed.getvalue()


def url_of(data: Path, environment: dict[str, str]) -> str:
    """The database of a server with this data folder and environment."""
    return environment.get("DATABASE_URL") or f"sqlite:///{data / 'shepherd.sqlite3'}"


@contextmanager
def _default_database(url: str) -> Iterator[None]:
    settings = dict(dj_database_url.parse(url))
    if settings["ENGINE"].endswith("sqlite3"):
        settings["OPTIONS"] = {"timeout": 60, "transaction_mode": "IMMEDIATE"}
    before, its = connections["default"], ConnectionHandler({"default": settings})["default"]
    connections["default"] = its
    try:
        yield
    finally:
        its.close()
        connections["default"] = before
