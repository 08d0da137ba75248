"""Real servers for tests: `manage.py serve` on a free port with a data folder of its own.

    with running_server(SHEPHERD_WEB_WORKERS=2) as server:
        agent, key = server.create_agent(algorithm="PPO")
        httpx.post(f"{server.url}api/v1/sessions", headers={"Authorization": f"Bearer {key}"})

The fixture `server` (conftest.py) shares one among the tests; take your own only if you kill or configure something.
"""

from __future__ import annotations

import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import psutil

from envs_app.serving import bond
from tests import databases

PROJECT = Path(__file__).resolve().parent.parent
START_SECONDS, STOP_SECONDS = 240, 120  # on a machine that others load, too
OPTIONS = {"advice", "rho", "advisor", "policy"}  # of create_agent; the other fields of an agent go through --set
NAMES = itertools.count(1)
SETTINGS: dict[str, str] = {}  # of every server that is not told otherwise, beside the product's own defaults


class Server:
    """A running `manage.py serve`, or another command of manage.py that serves.

    It ends when the process of the tests does, however that one ends.
    """

    def __init__(self, data: Path, environment: dict[str, Any], command: Sequence[str] = ("serve",)) -> None:
        self.data = data
        self.environment = environment_of(data) | SETTINGS | {name: str(value) for name, value in environment.items()}
        self.output = (data / "output.txt").open("ab")
        self.process = subprocess.Popen(
            [sys.executable, "-I", "-S", bond.__file__, str(os.getpid()), sys.executable, "manage.py", *command],
            cwd=PROJECT,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=self.output,
            stderr=subprocess.STDOUT,
            process_group=0,
        )

    @property
    def pid(self) -> int:
        """The supervisor."""
        return self.process.pid

    @property
    def state(self) -> dict[str, Any]:
        """What the supervisor tells of itself: run/serve.json."""
        state = json.loads((self.data / "run" / "serve.json").read_text())
        if state["pid"] != self.pid:
            raise FileNotFoundError("serve.json is of an earlier server")
        return state

    @property
    def url(self) -> str:
        """Where it serves, with a slash at the end."""
        return self.state["url"]

    def parent_pid(self) -> int | None:
        """The parent of the executions; None while it is being restarted."""
        return self.state["processes"]["executions"]

    def granian_pid(self) -> int | None:
        """The main process of the web; None while it is being restarted."""
        return self.state["processes"]["web"]

    def web_pids(self) -> list[int]:
        """The web processes that answer requests."""
        return children_of(self.granian_pid())

    def execution_pids(self) -> list[int]:
        """The executions."""
        return children_of(self.parent_pid())

    def processes(self) -> list[psutil.Process]:
        """Everything that lives with this server's data folder, whoever its parent is."""
        return processes_of(self.data)

    def manage(self, *arguments: str) -> str:
        """What `manage.py` prints for these arguments. Raises CalledProcessError, with the output, when it fails."""
        command = [sys.executable, "manage.py", *arguments]
        done = subprocess.run(command, cwd=PROJECT, env=self.environment, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"manage.py {' '.join(arguments)} failed:\n{done.stdout}\n{done.stderr}")
        return done.stdout

    def make(self, *arguments: str) -> str:
        """The same for what only makes rows in the database, in this process where that has Django."""
        if not databases.can_call():
            return self.manage(*arguments)
        return databases.call(databases.url_of(self.data, self.environment), *arguments)

    def create_agent(
        self,
        *,
        owner: str = "tester",
        name: str = "",
        algorithm: str = "PPO",
        action_space: Any = 2,
        observation_space: Any = ((4,), -10, 10),
        parameters: dict[str, Any] | None = None,
        **options: Any,
    ) -> tuple[str, str]:
        """A new agent: its id and an API key. `options` are further fields, e.g. `rho=0.5, max_executions=4`."""
        arguments = ["--owner", owner, "--name", name or f"agent {next(NAMES)}", "--algorithm", algorithm]
        arguments += ["--action-space", json.dumps(action_space), "--observation-space", json.dumps(observation_space)]
        for key, value in (parameters or {}).items():
            arguments += ["--parameter", f"{key}={value}"]
        for key, value in options.items():
            arguments += [f"--{key}", str(value)] if key in OPTIONS else ["--set", f"{key}={value}"]
        made = json.loads(self.make("create_agent", *arguments))
        return made["id"], made["api_key"]

    def is_ready(self) -> bool:
        """Whether /readyz says that it can serve."""
        try:
            with urllib.request.urlopen(f"{self.url}readyz", timeout=5) as answer:
                return answer.status == 200
        except (OSError, KeyError, json.JSONDecodeError, urllib.error.URLError):
            return False

    def wait_until_ready(self, seconds: float = START_SECONDS) -> None:
        """Wait for /readyz. Raises RuntimeError, with what was printed and logged, when it does not come."""
        deadline = time.monotonic() + seconds
        while not self.is_ready():
            if self.process.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError(f"the server does not get ready:\n{self.printed()}\n{self.logged()}")
            time.sleep(0.05)

    def printed(self) -> str:
        """What it said on the terminal."""
        return (self.data / "output.txt").read_text()

    def logged(self) -> str:
        """The ends of its logs."""
        logs = sorted((self.data / "logs").glob("*.log"))
        return "\n".join(f"--- {log.name}\n{log.read_text(errors='replace')[-4000:]}" for log in logs)

    def stop(self, number: int = signal.SIGTERM) -> int:
        """Ask it to stop and wait. Returns the exit code."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        return self.process.wait(STOP_SECONDS)

    def end(self) -> list[str]:
        """Stop it, and kill what is left over. Returns the command lines of what was."""
        try:
            self.stop()
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        left = [f"{process.pid} {title_of(process)}" for process in self.processes()]
        for process in self.processes():
            with suppress(psutil.NoSuchProcess):
                process.kill()
        self.output.close()
        return left


@contextmanager
def running_server(data: Path | None = None, ready: bool = True, **environment: Any) -> Iterator[Server]:
    """A server with these environment variables, ended afterwards. Fails when it leaves a process behind.

    Give `data` to serve a data folder that another server used before.
    """
    folder = data or Path(tempfile.mkdtemp(prefix="shepherd-"))
    folder.mkdir(parents=True, exist_ok=True)
    server = Server(folder, environment)
    try:
        if ready:
            server.wait_until_ready()
        yield server
    finally:
        left = server.end()
        if data is None:
            shutil.rmtree(folder, ignore_errors=True)
    assert not left, f"the server left processes behind: {left}"


def processes_of(data: Path) -> list[psutil.Process]:
    """The living processes whose SHEPHERD_DATA is `data`."""
    return [process for process in psutil.process_iter() if _data_of(process) == str(data)]


def environment_of(data: Path) -> dict[str, str]:
    """This environment without settings of a developer's own server. SPT_NOENV keeps /proc/*/environ readable."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("SHEPHERD_", "DJANGO_"))}
    for name in ("DATABASE_URL", "REDIS_URL", "HOST"):
        kept.pop(name, None)
    return kept | {"SHEPHERD_DATA": str(data), "PORT": "0", "SPT_NOENV": "1", "PYTHONUNBUFFERED": "1"}


def title_of(process: psutil.Process) -> str:
    """Its command line; "?" when it is gone."""
    try:
        return " ".join(process.cmdline())
    except psutil.Error:
        return "?"


def children_of(pid: int | None) -> list[int]:
    """The children of a process, if there is one."""
    try:
        return [child.pid for child in psutil.Process(pid).children()] if pid else []
    except psutil.NoSuchProcess:
        return []


def wait_for(condition: Any, seconds: float = 90, what: str = "") -> Any:
    """The first true value of `condition()`. Raises AssertionError when none comes in time."""
    deadline = time.monotonic() + seconds
    while not (value := condition()):
        assert time.monotonic() < deadline, f"waited {seconds} s in vain for {what or condition}"
        time.sleep(0.05)
    return value


def _data_of(process: psutil.Process) -> str | None:
    try:
        return process.environ().get("SHEPHERD_DATA") if process.status() != psutil.STATUS_ZOMBIE else None
    except (psutil.Error, OSError):
        return None
