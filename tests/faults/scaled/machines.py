"""Worker machines in network namespaces, with addresses of their own, on a bridge to this one: any may be cut off.

    host 10.213.N.1 (bridge) ── Redis, PostgreSQL, web, beat, clients
        ├── machine1 10.213.N.11   celery -A shepherd worker
        └── machine2 10.213.N.12   celery -A shepherd worker

Only root may do that, with `ip` of iproute2; elsewhere the test is skipped and says why.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import psutil
import pytest

from envs_app.serving import bond
from envs_app.serving.scaled import LEAN
from tests.servers import PROJECT, STOP_SECONDS, processes_of


def ip(*words: str) -> None:
    """`ip` with these words. Raises RuntimeError with what it says when it fails."""
    done = subprocess.run(["ip", *words], capture_output=True, text=True, timeout=30)
    if done.returncode:
        raise RuntimeError(f"ip {' '.join(words)}: {done.stderr.strip()}")


NAME = f"shp{os.getpid()}"  # of this process's network; an interface has 15 characters at most


class Cable:
    """What connects a namespace to the bridge."""

    def __init__(self, network: Network, number: int) -> None:
        self.namespace = f"{network.name}-{number}"
        self.end = f"{network.name}v{number}"  # the end on the bridge
        self.address = f"{network.prefix}.{10 + number}"
        ip("netns", "add", self.namespace)
        ip("link", "add", self.end, "type", "veth", "peer", "name", "eth0", "netns", self.namespace)
        ip("link", "set", self.end, "master", network.name, "up")
        ip("-n", self.namespace, "addr", "add", f"{self.address}/24", "dev", "eth0")
        for device in ("lo", "eth0"):
            ip("-n", self.namespace, "link", "set", device, "up")

    def cut(self) -> None:
        """Nothing comes through any more, and nobody is told."""
        ip("link", "set", self.end, "down")

    def mend(self) -> None:
        """It connects again."""
        ip("link", "set", self.end, "up")


class Network:
    """A bridge with this machine's own address on it, and cables to it."""

    def __init__(self) -> None:
        self.name = NAME
        self.prefix = f"10.213.{os.getpid() % 256}"
        self.address = f"{self.prefix}.1"
        ip("link", "add", self.name, "type", "bridge")
        ip("addr", "add", f"{self.address}/24", "dev", self.name)
        ip("link", "set", self.name, "up")


def remove(name: str) -> None:
    """Leave nothing of a network behind, however far it came."""
    for namespace in _names("netns", "list"):
        if namespace.startswith(f"{name}-"):
            ip("netns", "del", namespace)
    for link in _names("-brief", "link"):
        if re.fullmatch(rf"{name}(v\d+)?", link):
            with suppress(RuntimeError):  # it went with its namespace
                ip("link", "del", link)


def remove_forgotten() -> None:
    """What was left by tests that were killed."""
    for name in {found[1] for link in _names("-brief", "link") if (found := re.fullmatch(r"(shp\d+)(v\d+)?", link))}:
        if not psutil.pid_exists(int(name.removeprefix("shp"))):
            remove(name)


@contextmanager
def network() -> Iterator[Network]:
    """One, removed afterwards. Skips the test where there cannot be one."""
    if os.geteuid() or not shutil.which("ip"):
        pytest.skip("needs root and `ip`, to make network namespaces (Debian: apt install iproute2)")
    try:
        remove_forgotten()
        try:
            made = Network()
            Cable(made, 0)
        except RuntimeError as error:
            pytest.skip(f"this machine makes no network namespaces: {error}")
        yield made
    finally:
        remove(NAME)


class Machine:
    """A worker in a namespace, as its own process group."""

    def __init__(self, cable: Cable, environment: dict[str, str]) -> None:
        self.cable = cable
        self.data = Path(tempfile.mkdtemp(prefix="shepherd-machine-"))
        worker = [sys.executable, "-m", "celery", "-A", "shepherd", "worker", "-Q", "small,large", *LEAN]
        inside = [shutil.which("ip") or "ip", "netns", "exec", cable.namespace, *worker]
        with (self.data / "output.txt").open("wb") as output:
            self.process = subprocess.Popen(
                [sys.executable, "-I", "-S", bond.__file__, str(os.getpid()), *inside, "-n", f"w@{cable.namespace}"],
                cwd=PROJECT,
                env=environment | {"SHEPHERD_DATA": str(self.data), "SHEPHERD_LOG": "stderr"},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                process_group=0,
            )

    def executions(self) -> list[str]:
        """Those that run here: the titles of their processes, which are padded with spaces."""
        titles = [" ".join(_command_line(process)).strip() for process in processes_of(self.data)]
        return [title for title in titles if title.startswith("shepherd: execution")]

    def printed(self) -> str:
        """Its log."""
        return (self.data / "output.txt").read_text(errors="replace")

    def end(self) -> None:
        """In order, else at once."""
        try:
            self.process.terminate()
            self.process.wait(STOP_SECONDS)
        except subprocess.TimeoutExpired:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
        shutil.rmtree(self.data, ignore_errors=True)


@contextmanager
def machines(net: Network, number: int, environment: dict[str, str]) -> Iterator[list[Machine]]:
    """So many worker machines on a network."""
    with ExitStack() as stack:
        made = []
        for count in range(1, number + 1):
            made.append(Machine(Cable(net, count), environment))
            stack.callback(made[-1].end)
        yield made


def _command_line(process: psutil.Process) -> list[str]:
    try:
        return process.cmdline()
    except psutil.Error:
        return []


def _names(*listing: str) -> list[str]:
    """What `ip` lists, by name; of a cable, without its other end."""
    lines = subprocess.run(["ip", *listing], capture_output=True, text=True, timeout=30).stdout.splitlines()
    return [re.split(r"[ @]", line)[0] for line in lines if line.strip()]
