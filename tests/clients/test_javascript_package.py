"""The JavaScript module by itself: its unit tests, and its types."""

from __future__ import annotations

import subprocess

import pytest

import envs_app.errors
from tests.clients.driving import NEEDS_NODE, PROJECT

HOME = PROJECT / "clients" / "javascript"


def run(*command: str) -> None:
    """Run a command in the module's folder; a failure shows what it printed."""
    done = subprocess.run(command, cwd=HOME, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stdout + done.stderr


@NEEDS_NODE
def test_its_unit_tests_pass() -> None:
    run("npm", "test")


def test_its_types_hold() -> None:
    if not (HOME / "node_modules" / "typescript").exists():
        pytest.skip("TypeScript is not installed: npm install, in clients/javascript")
    run("npm", "run", "types")


def test_every_error_of_the_server_has_a_class_of_its_own() -> None:
    module, types = (HOME / "shepherd-client.js").read_text(), (HOME / "shepherd-client.d.ts").read_text()
    for code, theirs in envs_app.errors.BY_CODE.items():
        transient = theirs.status in (429, 503) or code == "step_pending"
        heading = f"export class {theirs.__name__} extends {'TransientError' if transient else 'ShepherdError'}"
        assert f'{heading} {{ static code = "{code}"; }}' in module
        assert heading in types
