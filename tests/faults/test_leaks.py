"""What runs for months must not gather descriptors, sockets, processes or files."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path

from shepherd_client import Client

from tests.faults.inside import HERE, executions_of, play, transport, zombies
from tests.servers import Server, wait_for

Agent = Callable[[str], tuple[str, str]]


def descriptors(pid: int) -> dict[str, str]:
    """The open files of a process."""
    found = {}
    for link in Path(f"/proc/{pid}/fd").iterdir():
        try:
            found[link.name] = str(link.readlink())
        except FileNotFoundError:
            continue  # closed meanwhile
    return found


def sockets(pid: int) -> set[str]:
    """The sockets that a process has open."""
    return {target for target in descriptors(pid).values() if target.startswith("socket:")}


def test_an_execution_inherits_nothing_of_the_parent_or_the_others(own: Server, agent: Agent) -> None:
    with Client(agent("other")[1], own.url) as client:
        for session in [client.session() for _ in range(4)]:
            session.step(HERE)
        parent, executions = own.parent_pid(), own.execution_pids()
        assert parent
        seen = sockets(parent)
        for pid in executions:
            assert not seen & sockets(pid)
            seen |= sockets(pid)
            assert not [target for target in descriptors(pid).values() if "sqlite" in target]


def test_nothing_grows_while_executions_come_and_go(own: Server, agent: Agent) -> None:
    identity, key = agent("other")
    with Client(key, own.url) as client:
        session = client.session()

        def lose_executions(times: int) -> dict[int, int]:
            for turn in range(times):
                play(session, 20)
                for execution in executions_of(own, identity):
                    os.kill(execution["pid"], signal.SIGKILL if turn % 2 else signal.SIGTERM)
            play(session, 20)
            return {pid: len(descriptors(pid)) for pid in [*own.web_pids(), own.parent_pid() or 0, own.pid]}

        before = lose_executions(4)
        after = lose_executions(12)
    assert {pid: count for pid, count in after.items() if count > before[pid] + 4} == {}
    wait_for(lambda: not zombies(own), what="the dead to be buried")


def test_a_closed_session_leaves_no_ledger(own: Server, agent: Agent) -> None:
    with Client(agent("other")[1], own.url) as client:
        before = set((own.data / "ledger").iterdir())
        sessions = [client.session() for _ in range(5)]
        for session in sessions:
            play(session, 25)
        assert len(set((own.data / "ledger").iterdir()) - before) == 5
    wait_for(lambda: set((own.data / "ledger").iterdir()) <= before, what="the ledgers to go")


def test_idle_executions_end_and_leave_nothing(own: Server, agent: Agent) -> None:
    """Orderly, as the parent ends them; their sockets and weights go with them."""
    identity, key = agent("other")
    with Client(key, own.url) as client:
        play(client.session(), 100)
        uids = [execution["uid"] for execution in executions_of(own, identity)]
        assert uids
        transport(own).stop(identity, "idle")
        wait_for(lambda: not executions_of(own, identity), what="the executions to end")
    assert not [path for path in (own.data / "run").iterdir() if path.stem in uids]
