"""kill -9 of any part while eight clients step: each repeats a step at most, and nothing that was answered is lost."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable

import numpy as np
import pytest
from shepherd_client import Client

from tests.faults.conftest import INTERVAL, QUICK
from tests.faults.inside import executions_of, play, policy_of, saves_of, transport, zombies
from tests.faults.players import one_hangs, playing, query
from tests.servers import Server, wait_for

Agent = Callable[[str], tuple[str, str]]
OLDEST = (
    INTERVAL + 2 * QUICK["n_steps"]
)  # steps since a save: the interval, to the end of a rollout, and the actor's lead


@pytest.mark.parametrize("name", ["killed", "shared", "playing itself"])
def test_clients_survive_the_death_of_an_execution(own: Server, agent: Agent, name: str) -> None:
    identity, key = agent(name)
    with playing(own, key) as players:
        for _ in range(3):
            killed = executions_of(own, identity)[0]["pid"]
            os.kill(killed, signal.SIGKILL)
            players.play_on(2)
            assert killed not in own.execution_pids()
    transport(own).stop(identity, "idle")


def test_clients_survive_the_death_of_all_executions_at_once(own: Server, agent: Agent) -> None:
    with playing(own, agent("killed")[1]) as players:
        for killed in own.execution_pids():
            os.kill(killed, signal.SIGKILL)
        players.play_on()


def test_clients_survive_the_death_of_the_parent(own: Server, agent: Agent) -> None:
    with playing(own, agent("killed")[1]) as players:
        killed, executions = own.parent_pid(), own.execution_pids()
        os.kill(killed, signal.SIGKILL)
        players.play_on()
        assert own.parent_pid() != killed
        wait_for(lambda: not set(executions) & {p.pid for p in own.processes()}, what="the orphans to end")


def test_clients_survive_the_death_of_web_processes(own: Server, agent: Agent) -> None:
    with playing(own, agent("killed")[1]) as players:
        for _ in range(4):
            os.kill(own.web_pids()[0], signal.SIGKILL)
            players.play_on(2)


def test_learning_goes_on_from_a_save_at_most_one_interval_old(own: Server, agent: Agent) -> None:
    """The learning rate is next to nothing, so the weights show whether they came from the save or were drawn anew."""
    identity, key = agent("constant")
    with Client(key, own.url) as client:
        session = client.session()
        play(session, 1000)
        saves = saves_of(own, identity)
        wait_for(lambda: any(meta.steps > 1000 - OLDEST for _, meta in saves.metas()), what="a save")
        [killed] = executions_of(own, identity)
        os.kill(killed["pid"], signal.SIGKILL)
        _, before = next(saves.metas())
        learned = policy_of(saves)
        play(session, 500)
        wait_for(lambda: next(saves.metas())[1].execution != killed["uid"], what="a save of the successor")
        [successor] = executions_of(own, identity)
        _, after = next(saves.metas())
    assert after.execution == successor["uid"]
    assert before.steps < after.steps <= before.steps + 500
    assert after.updates > before.updates
    assert all(np.allclose(learned[layer], weights, atol=1e-6) for layer, weights in policy_of(saves).items())


def test_no_process_socket_or_place_is_left_over(own: Server, agent: Agent) -> None:
    agent("killed")
    live = transport(own).status()
    assert {execution["pid"] for execution in live} == set(own.execution_pids())
    assert not [execution for execution in live if execution["active_sessions"]]
    assert zombies(own) == []
    expected = {"serve.json", "serve.lock", "parent.sock", "counters"} | {
        f"{execution['uid']}.sock" for execution in live
    }
    found = {path.name for path in (own.data / "run").iterdir() if not path.name.startswith("weights-")}
    assert found == expected
    wait_for(lambda: rows_without_end(own) == {execution["uid"].replace("-", "") for execution in live}, 40, "the rows")


def rows_without_end(server: Server) -> set[str]:
    """The executions that the database takes for live."""
    return {uid for (uid,) in query(server, "SELECT uid FROM agents_app_execution WHERE ended_at IS NULL")}


def test_a_hung_execution_holds_up_nobody_else(own: Server, agent: Agent) -> None:
    """The others advise it all the while, and the parent has news for it; it reads none, and nobody waits for that."""
    with playing(own, agent("killed")[1]) as players:
        with one_hangs(own, players, 20):
            assert own.is_ready()
        players.play_on()
