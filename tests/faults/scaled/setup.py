"""`manage.py scaled` on a Redis and a PostgreSQL of its own, all of which a test may break."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.servers import Server, children_of, title_of
from tests.services import PostgresServer, RedisServer, running

SLOTS = 24  # of each worker: one alone has room for the clients of a test
CONNECTIONS = 12  # that PostgreSQL takes, and
POOL = 2  # that a process has: the threads of a web process share them


class Scaled(Server):
    """Two web processes, two workers and beat, with the services that they need."""

    def __init__(
        self, data: Path, redis: RedisServer, postgres: PostgresServer, *parts: str, **environment: Any
    ) -> None:
        self.redis, self.postgres = redis, postgres
        own = {"REDIS_URL": redis.url, "DATABASE_URL": postgres.url, "SHEPHERD_SLOTS": SLOTS}
        own |= {"SHEPHERD_DATABASE_POOL": POOL}
        super().__init__(data, own | environment, ("scaled", *parts))

    def part(self, name: str) -> int | None:
        """The process id of web1, web2, worker1, worker2 or beat; None while it is being restarted."""
        return self.state["processes"][name]

    def granian_pids(self) -> list[int]:
        """The main processes of the web."""
        return [pid for name, pid in self.state["processes"].items() if name.startswith("web") and pid]

    def web_pids(self) -> list[int]:
        """The web processes that answer requests."""
        return [child for pid in self.granian_pids() for child in children_of(pid)]

    def execution_pids(self) -> list[int]:
        """The children of the workers that are executions."""
        return [process.pid for process in self.processes() if title_of(process).startswith("shepherd: execution")]


@contextmanager
def running_scaled(*parts: str, **environment: Any) -> Iterator[Scaled]:
    """The whole set-up, ready, and ended afterwards. `parts`: e.g. "--workers=4". Fails when it leaves a process behind."""
    data = Path(tempfile.mkdtemp(prefix="shepherd-"))
    with running(RedisServer()) as redis, running(PostgresServer(max_connections=CONNECTIONS)) as postgres:
        server = Scaled(data, redis, postgres, *parts, **environment)
        try:
            server.wait_until_ready()
            yield server
        finally:
            left = server.end()
            shutil.rmtree(data, ignore_errors=True)
    assert not left, f"the set-up left processes behind: {left}"
