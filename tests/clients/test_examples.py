"""The examples run as their first lines say, against a live server."""

from __future__ import annotations

import itertools
import json
import os
import re
import shlex
import shutil
import subprocess
import sys

import pytest

from tests.clients.driving import NEEDS_NODE, PROJECT, PYTHON_PATH
from tests.servers import Server

EXAMPLES = PROJECT / "clients" / "examples"
NUMBERS = itertools.count(1)


def create_agent(server: Server, example: str) -> str:
    """The API key of an agent made by the command that the example's head shows, for an owner of its own."""
    text = re.sub(r"\\+\n[ #*]*", " ", (EXAMPLES / example).read_text())
    command = re.search(r"manage\.py (create_agent .*)", text)
    assert command, f"{example} does not say how to make its agent"
    return json.loads(server.manage(*shlex.split(command[1]), "--owner", f"{example} {next(NUMBERS)}"))["api_key"]


def run(server: Server, interpreter: str, example: str, *arguments: str, typed: str = "") -> str:
    """What the example prints."""
    key = create_agent(server, example)
    environment = os.environ | {"PYTHONPATH": PYTHON_PATH, "SHEPHERD_URL": server.url, "SHEPHERD_API_KEY": key}
    command = [interpreter, str(EXAMPLES / example), *arguments]
    done = subprocess.run(command, env=environment, input=typed, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize(
    ("example", "interpreter"),
    [("cart_pole.py", sys.executable), pytest.param("cart_pole.mjs", "node", marks=NEEDS_NODE)],
)
def test_cart_pole(server: Server, example: str, interpreter: str) -> None:
    printed = run(server, interpreter, example, "3")
    assert re.fullmatch(r"episode 1: \d+\nepisode 2: \d+\nepisode 3: \d+\n", printed)


def test_lunar_lander(server: Server) -> None:
    printed = run(server, sys.executable, "lunar_lander.py", "2")
    assert re.fullmatch(r"mean return of the last 2 episodes: -?\d+\.\d\n", printed)


def test_thermostat_with_a_simulated_person(server: Server) -> None:
    printed = run(server, sys.executable, "thermostat.py", "--simulate", "--days", "2")
    assert re.fullmatch(r"day 1: return -?\d+\.\d\nday 2: return -?\d+\.\d\n", printed)


def test_thermostat_with_thumbs_typed(server: Server) -> None:
    options = ["--days", "1", "--seconds", "0.005"]
    printed = run(server, sys.executable, "thermostat.py", *options, typed="+" * 5000 + "--\n")
    assert re.search(r"-?\d+\.\d °C inside, -?\d+\.\d °C outside, heater (off|half|full)\n", printed)
    total = float(printed.splitlines()[-1].removeprefix("day 1: return "))
    assert 4998 - 28.8 <= total <= 4998  # thumbs, and the price of the electricity


@pytest.mark.skipif(shutil.which("curl") is None, reason="needs curl")
def test_curl(server: Server) -> None:
    printed = run(server, "sh", "curl.sh")
    replies = [json.loads(line) for line in printed.splitlines() if line.startswith("{")]
    actions = [reply["action"] for reply in replies if "action" in reply]
    assert [action in (0, 1) for action in actions] == [True, True, False, False, True, True, False, False]
    assert [reply["episode_return"] for reply in replies if reply.get("episode_return")] == [2.0, 2.0]
