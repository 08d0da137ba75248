"""Other commands of manage.py, each in a process of its own: `migrate` loads torch, and 200 MB would stay."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import Any

from django.conf import settings

from envs_app.serving.preflight import StartError


def manage(*arguments: str) -> str:
    """What `manage.py` prints for these arguments. Raises StartError with its reason."""
    done = subprocess.run(  # noqa: S603 - our own commands
        [sys.executable, "manage.py", *arguments],
        cwd=settings.BASE_DIR,
        env=os.environ | {"SHEPHERD_DATA": str(settings.DATA_DIR)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
    )
    if done.returncode:
        raise StartError(f"manage.py {arguments[0]} failed: {_reason(done.stderr) or f'exit code {done.returncode}'}")
    return done.stdout


def _reason(stderr: str) -> str:
    """The exception at the end of a traceback; its further lines are indented."""
    lines = [line for line in stderr.splitlines() if line[:1].strip()]
    return lines[-1] if lines else ""


def prepare(demo_data: bool) -> dict[str, Any]:
    """Bring the database up to date; with `demo_data`, make what is missing of that and return its new secrets."""
    manage("migrate", "--verbosity", "0", "--no-input")
    return json.loads(manage("demo_data") or "{}") if demo_data else {}
