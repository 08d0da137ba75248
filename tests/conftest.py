"""Fixtures that several rooms use, and the rule that continuous integration skips nothing."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

from shepherd import env
from tests import databases
from tests.servers import SETTINGS, Server, running_server
from tests.services import PostgresServer, RedisServer, fresh_database, running

NEVER_SKIPPED_IN_CI = ("browser", "service")
SERVICES = {"postgres_url", "postgres_server", "redis_server"}  # fixtures; whoever takes one is marked as `service`
WAITING = {"faults", "serving", "training", "transports", "clients", "experiments"}  # folders

SETTINGS["SHEPHERD_WEB_WORKERS"] = "1"  # a second web process takes a second of CPU to start, sixty times


@pytest.fixture(scope="session")
def server() -> Iterator[Server]:
    """One server for all tests that neither kill nor configure it."""
    with running_server() as shared:
        yield shared


@pytest.fixture
def make_server() -> Iterator[Callable[..., Server]]:
    """Starts servers for one test: `make_server(SHEPHERD_WEB_WORKERS=2)`."""
    with ExitStack() as stack:
        yield lambda **environment: stack.enter_context(running_server(**environment))


@pytest.fixture
def data() -> Iterator[Path]:
    """A data folder that outlives its servers: `running_server(data)`."""
    with TemporaryDirectory(prefix="shepherd-", ignore_cleanup_errors=True) as folder:
        yield Path(folder)


@pytest.fixture
def postgres_url() -> Iterator[str]:
    """The DATABASE_URL of an empty database in PostgreSQL."""
    with fresh_database() as url:
        yield url


@pytest.fixture
def postgres_server() -> Iterator[PostgresServer]:
    """A PostgreSQL that this test may kill, pause and start again."""
    with running(PostgresServer()) as postgres:
        yield postgres


@pytest.fixture
def redis_server() -> Iterator[RedisServer]:
    """A Redis that this test may kill, pause, flush and start again."""
    with running(RedisServer()) as redis:
        yield redis


@pytest.fixture(scope="session", autouse=True)
def _databases_of_servers(django_db_blocker: Any) -> None:
    """Let tests make agents in the databases of the servers that they start."""
    databases.unblocked = django_db_blocker.unblock


@pytest.fixture(autouse=True)
def _data_folder(request: pytest.FixtureRequest, tmp_path: Path) -> None:
    """Keep tests inside this process away from the developer's own data folder."""
    settings: Any = request.getfixturevalue("settings")
    settings.DATA_DIR = tmp_path / "data"
    saves = env.storage("", {}, settings.DATA_DIR / "saves")
    settings.STORAGES = settings.STORAGES | {"saves": saves}
    settings.STATIC_ROOT, settings.LOG_DIR = settings.DATA_DIR / "static", settings.DATA_DIR / "logs"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark who needs a service, and begin with the files that start and kill servers and mostly wait.

    So no worker ends alone with one of them. (pytest-xdist keeps this order only with --no-loadscope-reorder.)
    """
    for item in items:
        if SERVICES.intersection(getattr(item, "fixturenames", ())):
            item.add_marker("service")
    items.sort(key=lambda item: not WAITING.intersection(item.path.parts))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Any:
    """Where CI is set, a test that misses its browser or service fails."""
    report = yield
    if report.skipped and os.environ.get("CI") and any(map(item.get_closest_marker, NEVER_SKIPPED_IN_CI)):
        report.outcome, report.longrepr = "failed", f"skipped, though CI skips no such test: {report.longrepr[2]}"
    return report
