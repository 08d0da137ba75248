"""The command shepherd-client, as somebody at a terminal meets it, against a live server."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
import time

import gymnasium
import httpx
import pytest

from agents_app.spaces import parse_space
from tests.clients.driving import PYTHON_PATH
from tests.servers import Server


def start(*arguments: str, key: str = "") -> subprocess.Popen[str]:
    """The command, started."""
    environment = os.environ | {"PYTHONPATH": PYTHON_PATH, "SHEPHERD_API_KEY": key}
    command = [sys.executable, "-m", "shepherd_client", *arguments]
    return subprocess.Popen(
        command,
        env=environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=heed_interrupts,
    )


def heed_interrupts() -> None:
    """As at a terminal: a shell's background jobs ignore Ctrl-C, and so would everything that they start."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def run(*arguments: str, key: str = "") -> tuple[int, str, str]:
    """The exit code of the command and what it prints."""
    process = start(*arguments, key=key)
    output, errors = process.communicate(timeout=100)
    return process.returncode, output, errors


def returns(server: Server, key: str) -> list[float]:
    """The returns that the server has of the agent."""
    reply = httpx.get(f"{server.url}api/v1/agent/returns", headers={"Authorization": f"Bearer {key}"})
    return [episode["return"] for episode in reply.json()["results"]]


@pytest.fixture(scope="module")
def cart_pole(server: Server) -> str:
    """The key of an agent for Cart Pole."""
    return server.create_agent(name="clients: command")[1]


def test_describe_prints_the_spaces_as_create_agent_takes_them() -> None:
    code, output, _ = run("--env", "LunarLander-v3", "--describe")
    action, _, observation = (word for word in shlex.split(output) if word != "--action-space")
    assert code == 0
    assert parse_space(json.loads(action)) == gymnasium.spaces.Discrete(4)
    assert parse_space(json.loads(observation)).shape == (8,)


def test_it_trains_and_says_how_well_it_went(server: Server, cart_pole: str) -> None:
    before = returns(server, cart_pole)
    code, output, errors = run(
        "--env", "CartPole-v1", "--episodes", "5", "--seed", "1", "--url", server.url, key=cart_pole
    )
    assert code == 0, errors
    mean = sum(returns(server, cart_pole)[len(before) :]) / 5
    assert output == f"5 episodes; mean return of the last 5: {mean:.1f}\n"
    assert "episode 5, return" in errors  # the progress bar


def test_it_stops_after_a_number_of_steps(server: Server, cart_pole: str) -> None:
    code, output, errors = run("--env", "CartPole-v1", "--steps", "100", "--url", server.url, key=cart_pole)
    assert code == 0, errors
    assert "100/100" in errors
    assert "episodes; mean return" in output


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_one_closes_its_session_and_sums_up(server: Server, cart_pole: str, number: int) -> None:
    before = len(returns(server, cart_pole))
    process = start("--env", "CartPole-v1", "--url", server.url, key=cart_pole)
    while len(returns(server, cart_pole)) < before + 3:
        assert process.poll() is None, process.communicate()
        time.sleep(0.1)
    process.send_signal(number)
    output, errors = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "episodes; mean return" in output
    assert "Traceback" not in errors


def test_a_wrong_key_is_told_in_a_line(server: Server) -> None:
    code, output, errors = run("--env", "CartPole-v1", "--url", server.url, key="sk_wrong")
    assert (code, output) == (1, "")
    assert errors.startswith("shepherd-client: ")
    assert "Traceback" not in errors


def test_an_agent_for_another_environment_is_told(server: Server, cart_pole: str) -> None:
    code, _, errors = run("--env", "LunarLander-v3", "--url", server.url, key=cart_pole)
    assert code == 1
    assert "is for another environment" in errors


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["--env", "CartPole-v1"], 2, "SHEPHERD_API_KEY"),
        (["--env", "NoSuchThing-v1", "--key", "sk_"], 1, "There is no environment"),
        (["--env", "CartPole-v1", "--key", "sk_", "--url", "localhost"], 1, "is no URL"),
        (["--env", "CartPole-v1", "--key", "sk_", "--episodes", "0"], 2, "write 1 or more"),
        (["--env", "Blackjack-v1", "--describe"], 1, "FlattenObservation"),
    ],
)
def test_wrong_usage_is_told_in_words(arguments: list[str], code: int, words: str) -> None:
    got, _, errors = run(*arguments)
    assert got == code
    assert words in errors
    assert "Traceback" not in errors
