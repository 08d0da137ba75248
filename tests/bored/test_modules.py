"""The modules of Bored in the city, in Node: by themselves, and as a visitor of a real server with a real agent."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

from tests.clients.driving import NEEDS_NODE, PROJECT
from tests.servers import Server

HOME = PROJECT / "frontend" / "bored"
LIVE = PROJECT / "frontend" / "agents"  # the live page of an agent, beside it


def run(*command: str, **environment: str) -> None:
    """Run a command in the page's folder; a failure shows what it printed."""
    known = os.environ | environment
    done = subprocess.run(command, cwd=HOME, env=known, capture_output=True, text=True, timeout=110)
    assert done.returncode == 0, done.stdout + done.stderr


@NEEDS_NODE
@pytest.mark.parametrize("home", [HOME, LIVE], ids=lambda home: home.name)
def test_the_modules_pass_their_tests(home: Path) -> None:
    run("node", "--test", *sorted(str(path) for path in (home / "test").glob("*.test.js")))


@NEEDS_NODE
def test_a_visitor_and_an_agent_understand_each_other(server: Server) -> None:
    made = json.loads(
        server.manage(
            "create_agent", "--owner=bored", "--name=node's visitor", "--algorithm=MaskablePPO", "--publishable",
            "--action-space=179", "--observation-space=[[29], -1, 1]", "--set=sessions_per_execution=100",
        )
    )  # fmt: skip
    run(
        "node",
        "--test",
        "test/server/visitor.test.js",
        SHEPHERD_URL=server.url.rstrip("/"),
        SHEPHERD_PUBLISHABLE_KEY=made["publishable_key"],
        SHEPHERD_API_KEY=made["api_key"],
    )


@pytest.mark.parametrize("home", [HOME, LIVE], ids=lambda home: home.name)
def test_the_types_hold(home: Path) -> None:
    if not (HOME / "node_modules" / "typescript").exists():
        pytest.skip("TypeScript is not installed: npm install, in frontend/bored")
    run("npm", "exec", "--", "tsc", "--project", str(home))
