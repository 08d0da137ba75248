"""Programs in any language that drive their client as they are told, a JSON line at a time."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import pytest

PROJECT = Path(__file__).resolve().parent.parent.parent
DRIVERS = Path(__file__).parent / "drivers"
NEEDS_NODE = pytest.mark.skipif(shutil.which("node") is None, reason="needs Node 20")
PYTHON_PATH = os.pathsep.join(str(PROJECT / "clients" / room) for room in ("python", "environments"))


@dataclass
class ClientError(Exception):
    """The typed error that a client raised."""

    type: str
    code: str
    status: int
    retry_after: float | None
    message: str
    transient: bool

    def __str__(self) -> str:
        return f"{self.type} ({self.code}, {self.status}): {self.message}"


class Driver:
    """One process with one client and one session."""

    def __init__(self, command: list[str]) -> None:
        self._process = subprocess.Popen(
            command,
            env=os.environ | {"PYTHONPATH": PYTHON_PATH},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def __call__(self, op: str, **arguments: Any) -> Any:
        """What the operation returns. Raises ClientError if the client raised one of its own."""
        assert self._process.stdin and self._process.stdout
        self._process.stdin.write(json.dumps({"op": op, **arguments}) + "\n")
        self._process.stdin.flush()
        reply = json.loads(self._process.stdout.readline() or '{"crashed": "see its standard error"}')
        if "error" in reply:
            raise ClientError(**reply["error"])
        return reply["result"]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """End the process, without closing the session."""
        assert self._process.stdin
        self._process.stdin.close()
        self._process.wait(10)
