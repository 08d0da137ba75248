"""Two web processes: a session belongs to neither, and who repeats a step may ask the other."""

from __future__ import annotations

import os
import signal
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from shepherd_client import Client, SequenceGap, Session, StepPending

from tests.faults.inside import HERE
from tests.faults.players import returns_of_session
from tests.servers import Server, wait_for

Agent = Callable[[str], tuple[str, str]]


@contextmanager
def only(server: Server, number: int) -> Iterator[None]:
    """One web process alone answers; the others are stopped, and cannot take connections."""
    pids = wait_for(lambda: len(server.web_pids()) == 2 and sorted(server.web_pids()), what="two web processes")
    others = [pid for index, pid in enumerate(pids) if index != number]
    for pid in others:
        os.kill(pid, signal.SIGSTOP)
        wait_for(lambda pid=pid: states(pid) == {"T"}, what="all threads to stop")  # one may yet take a connection
    try:
        yield
    finally:
        for pid in others:
            os.kill(pid, signal.SIGCONT)


def states(pid: int) -> set[str]:
    """The states of the threads of a process."""
    return {path.read_text().rpartition(")")[2].split()[0] for path in Path(f"/proc/{pid}/task").glob("*/stat")}


def hop(session: Session) -> None:
    """Ask whoever takes the next connection."""
    session._connection.close()


def test_a_session_hops_between_the_processes(own: Server, agent: Agent) -> None:
    with Client(agent("other")[1], own.url) as client:
        session = client.session()
        session.step(HERE)
        for step in range(20):
            hop(session)
            with only(own, step % 2):
                assert session.step(HERE, 1.0).action in (0, 1)
        hop(session)
        assert session.step(HERE, 1.0, terminated=True).episode_return == 21.0
    assert returns_of_session(own, session.key) == [(21.0, 21)]


def test_a_repeated_step_is_answered_by_the_other_process(own: Server, agent: Agent) -> None:
    with Client(agent("other")[1], own.url) as client:
        session = client.session()
        for step in range(12):
            hop(session)
            with only(own, 0):
                first = session.step(HERE, 1.0, terminated=step % 4 == 3)
            hop(session)
            session.seq -= 1
            with only(own, 1):
                assert session.step(HERE, 1.0, terminated=step % 4 == 3) == first
        hop(session)
    assert returns_of_session(own, session.key) == [(3.0, 3)] * 3


def test_two_clients_on_one_session_are_answered_once_a_number(own: Server, agent: Agent) -> None:
    """Both send every number; whichever comes first is stepped, the other gets the same answer or is told so."""
    with Client(agent("other")[1], own.url) as client:
        ours = client.session()
        theirs = client.resume(ours.key, 0)
        answers: dict[int, set[int | None]] = {}
        outcomes: Counter[str] = Counter()

        def play(session: Session) -> None:
            while session.seq < 300:
                try:
                    reply = session.step(HERE, 1.0, terminated=session.seq % 10 == 9)
                except (SequenceGap, StepPending) as error:
                    outcomes[error.code] += 1
                    session.seq = max(answers, default=0)
                else:
                    outcomes["answered"] += 1
                    answers.setdefault(reply.seq, set()).add(reply.action)

        threads = [threading.Thread(target=play, args=(session,)) for session in (ours, theirs)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(60)
        assert sorted(answers) == list(range(1, 301))
        assert all(len(given) == 1 for given in answers.values())
    assert returns_of_session(own, ours.key) == [(9.0, 9)] * 30


def test_two_clients_on_one_key_have_a_session_each(own: Server, agent: Agent) -> None:
    with Client(agent("other")[1], own.url) as client:
        one, other = client.session(), client.session()
        for step in range(20):
            assert one.step(HERE, 1.0).seq == other.step(HERE, -1.0).seq == step + 1
        assert one.step(HERE, 1.0, terminated=True).episode_return == 20.0
        assert other.step(HERE, -1.0, terminated=True).episode_return == -20.0
