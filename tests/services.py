"""Services beside Shepherd, for tests with the marker `service`: databases in PostgreSQL, and servers that may be killed.

    with fresh_database() as url, running_server(DATABASE_URL=url):
        ...
    with running(RedisServer("--appendonly", "yes")) as redis:
        redis.pause(), redis.resume(), redis.kill(), redis.start(), redis.command("flushall")

Where a program is missing, the test is skipped and says what to install; in CI it fails (conftest.py). The fixtures
`postgres_url`, `redis_server` and `postgres_server` (conftest.py) are these, one for each test.
"""

from __future__ import annotations

import atexit
import functools
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

import psutil
import psycopg
import pytest

POSTGRES_URL = os.environ.get("TEST_POSTGRES_URL", "postgres://postgres@127.0.0.1:5432")
START_SECONDS, STOP_SECONDS = 60, 30


class PrivateServer:
    """A server on a free port of 127.0.0.1, or of another address of this machine, with a folder of its own, which one test
    may kill, pause and start again.

    It ends when the process of the tests does, however that one ends.
    """

    owner: str | None = None  # the system user that runs it

    def __init__(self, address: str = "127.0.0.1") -> None:
        self.address = address
        self.port = free_port(address)
        self.folder = Path(tempfile.mkdtemp(prefix="shepherd-service-"))
        self.output = self.folder / "output.txt"
        self.process: subprocess.Popen[bytes] | None = None

    def command_line(self) -> list[str]:
        """What starts it, in the foreground. Skips the test if the program is not installed."""
        raise NotImplementedError

    def answers(self) -> bool:
        """Whether it serves."""
        raise NotImplementedError

    def start(self) -> None:
        """Start it (again, with the same port and folder) and wait until it serves."""
        command = ["setpriv", "--pdeathsig", "KILL", *_identity(self.owner), *self.command_line()]
        with self.output.open("ab") as output:
            self.process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=output, stderr=output)
        deadline = time.monotonic() + START_SECONDS
        while not self.answers():
            if self.process.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError(f"{command} does not serve:\n{self.output.read_text(errors='replace')}")
            time.sleep(0.02)

    def pause(self) -> None:
        """Let it answer nothing, with all connections open, until `resume`."""
        self._signal(signal.SIGSTOP)

    def resume(self) -> None:
        """End a pause."""
        self._signal(signal.SIGCONT)

    def kill(self) -> None:
        """kill -9, as when the machine that it runs on is lost."""
        self._signal(signal.SIGKILL)
        self.process.wait(STOP_SECONDS)

    def stop(self, number: int = signal.SIGINT) -> None:
        """An orderly end, which closes all connections."""
        self.process.send_signal(number)
        self.process.wait(STOP_SECONDS)

    def restart(self) -> None:
        """An orderly end and a new start."""
        self.stop()
        self.start()

    def end(self) -> None:
        """Leave no process and no file of it behind."""
        if self.process and self.process.poll() is None:
            self.kill()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _signal(self, number: int) -> None:
        server = psutil.Process(self.process.pid)
        for process in [server, *server.children(recursive=True)]:
            with suppress(psutil.NoSuchProcess):
                process.send_signal(number)


class RedisServer(PrivateServer):
    """A redis-server that forgets all when it ends. `options` go to it, e.g. `"--appendonly", "yes", "--maxmemory", "2mb"`."""

    def __init__(self, *options: str, address: str = "127.0.0.1") -> None:
        super().__init__(address)
        self.options = options

    @property
    def url(self) -> str:
        """The value of REDIS_URL."""
        return f"redis://{self.address}:{self.port}/0"

    def command_line(self) -> list[str]:
        """Without snapshots on the disk, unless the options say so."""
        address = ["--bind", self.address, "--port", str(self.port), "--dir", str(self.folder)]
        return [program("redis-server"), *address, "--save", "", *self.options]

    def answers(self) -> bool:
        """Whether it does; it says LOADING while it reads its file, and refuses before."""
        return self._cli("ping").stdout.strip() == "PONG"

    def command(self, *words: str, seconds: float = 60) -> str:
        """What it replies, e.g. to `command("config", "set", "maxmemory", "1mb")`.

        Raises RuntimeError on an error, and subprocess.TimeoutExpired when nothing comes in so many seconds.
        """
        done = self._cli(*words, seconds=seconds)
        if done.returncode:
            raise RuntimeError(f"redis: {' '.join(words)}: {done.stdout}{done.stderr}")
        return done.stdout.strip()

    def _cli(self, *words: str, seconds: float = 60) -> subprocess.CompletedProcess[str]:
        command = [program("redis-cli"), "-e", "-h", self.address, "-p", str(self.port), *words]
        return subprocess.run(command, capture_output=True, text=True, timeout=seconds)


class PostgresServer(PrivateServer):
    """A PostgreSQL with one empty database. `settings` are its own, e.g. `max_connections=10`; of `network` it trusts all."""

    owner = "postgres" if os.geteuid() == 0 else None  # it refuses to be run by root

    def __init__(self, address: str = "127.0.0.1", network: str = "", **settings: str | int) -> None:
        super().__init__(address)
        self.data = self.folder / "data"
        self.settings = {"listen_addresses": address, "unix_socket_directories": "", "fsync": "off"} | settings
        if self.owner:
            shutil.chown(self.folder, self.owner)
        initdb = [
            program("initdb"),
            "--no-sync",
            "--auth",
            "trust",
            "--username",
            "postgres",
            "--pgdata",
            str(self.data),
        ]
        subprocess.run(["setpriv", *_identity(self.owner), *initdb], check=True, capture_output=True, timeout=60)
        if network:
            with (self.data / "pg_hba.conf").open("a") as rules:
                rules.write(f"host all all {network} trust\n")

    @property
    def url(self) -> str:
        """The value of DATABASE_URL."""
        return f"postgres://postgres@{self.address}:{self.port}/postgres"

    def command_line(self) -> list[str]:
        """With its settings on the command line."""
        settings = [f"--{name}={value}" for name, value in self.settings.items()]
        return [program("postgres"), "-D", str(self.data), "-p", str(self.port), *settings]

    def answers(self) -> bool:
        """Whether it takes a connection."""
        with suppress(psycopg.OperationalError), psycopg.connect(self.url, connect_timeout=5):
            return True
        return False


AnyServer = TypeVar("AnyServer", bound=PrivateServer)


@contextmanager
def running(server: AnyServer) -> Iterator[AnyServer]:
    """The server, started, and ended afterwards."""
    try:
        server.start()
        yield server
    finally:
        server.end()


@contextmanager
def fresh_database() -> Iterator[str]:
    """The DATABASE_URL of an empty database in the shared PostgreSQL, dropped afterwards with whoever is connected to it."""
    name = f"shepherd_test_{uuid.uuid4().hex}"
    server = shared_postgres()
    _execute(server, f'CREATE DATABASE "{name}"')
    try:
        yield f"{server}/{name}"
    finally:
        _execute(server, f'DROP DATABASE "{name}" WITH (FORCE)')


@functools.cache
def shared_postgres() -> str:
    """The address of a PostgreSQL that nobody kills: of the one at TEST_POSTGRES_URL, else of one for this process."""
    with suppress(psycopg.OperationalError):
        _execute(POSTGRES_URL, "SELECT 1")
        return POSTGRES_URL
    server = PostgresServer()
    atexit.register(server.end)
    server.start()
    return server.url.rpartition("/")[0]


def free_port(address: str = "127.0.0.1") -> int:
    """A port of an address of this machine where nobody listens."""
    with socket.socket() as probe:
        probe.bind((address, 0))
        return probe.getsockname()[1]


def program(name: str) -> str:
    """Where a program is; Debian keeps those of PostgreSQL off the path. Skips the test if it is not installed."""
    debian = sorted(map(str, Path("/usr/lib/postgresql").glob("*/bin")), reverse=True)
    found = shutil.which(name, path=os.pathsep.join([*debian, os.environ.get("PATH", os.defpath), "/usr/sbin"]))
    return found or pytest.skip(f"needs {name} (Debian: apt install redis-server postgresql nginx-light)")


def _execute(server: str, statement: str) -> None:
    with psycopg.connect(f"{server}/postgres", autocommit=True, connect_timeout=10) as connection:
        connection.execute(statement)


def _identity(user: str | None) -> list[str]:
    """What makes setpriv change to a user."""
    return ["--reuid", user, "--regid", user, "--init-groups"] if user else []
