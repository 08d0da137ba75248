"""An algorithm that fails inside its execution: a clear 503, the traceback in the database, and nobody else notices."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from contextlib import closing, suppress
from typing import Any

import httpx
import pytest
from shepherd_client import Client, TransientError

from tests.faults.inside import HERE, play, saves_of, transport
from tests.faults.players import errors_of, playing
from tests.servers import Server, wait_for

Agent = Callable[[str], tuple[str, str]]


def set_parameter(server: Server, agent: str, name: str, column: str, value: Any) -> None:
    """Change a value in the database, past all checks."""
    with closing(sqlite3.connect(server.data / "shepherd.sqlite3", timeout=30)) as database, database:
        changed = database.execute(
            f"UPDATE agents_app_parametervalue SET {column} = ? WHERE agent_id = ? AND parameter_id IN "
            "(SELECT id FROM agents_app_parameter WHERE name = ?)",
            (value, agent.replace("-", ""), name),
        )
        assert changed.rowcount == 1


def expect_traceback(server: Server, agent: str, *texts: str) -> None:
    """One of the texts is in the summary of an error that has a traceback."""

    def found() -> bool:
        return any(
            "Traceback" in trace and any(t in summary for t in texts) for summary, trace in errors_of(server, agent)
        )

    wait_for(found, what=f"the error {texts}")


def test_one_that_fails_at_start_is_refused_reported_and_mended(own: Server, agent: Agent) -> None:
    identity, key = agent("refused")
    set_parameter(own, identity, "batch_size", "value_int", 1)
    with playing(own, agent("killed")[1]) as others, Client(key, own.url, patience=30) as client:
        session = client.session()
        for _ in range(3):
            answer = httpx.post(
                f"{own.url}api/v1/step",
                headers={"Authorization": f"Bearer {session.key}"},
                json={"obs": HERE, "reward": 0.0, "terminated": False, "truncated": False},
                timeout=30,
            )
            assert answer.status_code == 503
            assert answer.json()["code"] == "no_capacity"
            assert 0 < int(answer.headers["Retry-After"]) <= 10
            assert "Traceback" not in answer.text
        others.play_on()
        expect_traceback(own, identity, "batch_size", "AssertionError")
        set_parameter(own, identity, "batch_size", "value_int", 32)
        transport(own).stop(identity, "restart")  # what the administration's "restart executions" does
        play(session, 40)


def test_one_whose_learner_diverges_goes_on_when_it_is_mended(own: Server, agent: Agent) -> None:
    identity, key = agent("diverging")
    with playing(own, agent("killed")[1]) as others, Client(key, own.url, patience=30) as client:
        session = client.session()
        play(session, 500)
        saves = saves_of(own, identity)
        wait_for(lambda: saves.choose("latest"), what="a save")
        set_parameter(own, identity, "learning_rate", "value_float", 1e30)
        transport(own).stop(identity, "restart")
        with suppress(TransientError), Client(key, own.url, patience=0.5) as impatient:
            play(impatient.session(), 500)
        expect_traceback(own, identity, "no longer finite", "Expected parameter")
        others.play_on()
        set_parameter(own, identity, "learning_rate", "value_float", 0.0003)
        transport(own).stop(identity, "restart")
        play(session, 500)


@pytest.mark.parametrize("name", ["diverging SAC", "diverging TD3"])
def test_off_the_policy_no_action_is_made_of_nan(own: Server, agent: Agent, name: str) -> None:
    """What diverged is neither answered nor saved; the save before it stays the one to go on from."""
    identity, key = agent(name)
    with Client(key, own.url, patience=30) as client:
        session = client.session()
        play(session, 100)
        set_parameter(own, identity, "learning_rate", "value_float", 1e30)
        transport(own).stop(identity, "restart")
        with suppress(TransientError), Client(key, own.url, patience=0.5) as impatient:
            play(impatient.session(), 600)
        expect_traceback(own, identity, "no longer finite", "Expected parameter")
        set_parameter(own, identity, "learning_rate", "value_float", 0.0003)
        transport(own).stop(identity, "restart")
        play(session, 100)
