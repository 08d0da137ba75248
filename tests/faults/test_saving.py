"""Saving fails, or a save is damaged: acting goes on, the administration says why, and an older good save is used."""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path

from shepherd_client import Client, Session

from envs_app.execution.saves import MODEL, SaveStore
from tests.faults.conftest import INTERVAL
from tests.faults.disks import fill, small_disk
from tests.faults.inside import executions_of, play, saves_of, transport
from tests.faults.players import errors_of
from tests.servers import Server, wait_for

Agent = Callable[[str], tuple[str, str]]


def play_until_saved(session: Session, saves: SaveStore, after: int = 0) -> int:
    """Play until a save has more steps than `after`; how many it has."""
    play(session, 2 * INTERVAL)
    wait_for(lambda: newest(saves) > after, what="a save")
    return newest(saves)


def folder_of(server: Server, saves: SaveStore) -> Path:
    """Where they lie."""
    return server.data / "saves" / saves.prefix


def newest(saves: SaveStore) -> int:
    """The steps in the newest good save; 0 when there is none."""
    chosen = saves.choose("latest")
    return chosen[1].steps if chosen else 0


def expect_error(server: Server, agent: str, text: str) -> None:
    """The administration shows why it could not be saved."""
    wait_for(lambda: any(text in summary for summary, _ in errors_of(server, agent)), what="the error in the database")
    assert all("Traceback" in trace for summary, trace in errors_of(server, agent) if text in summary)


def kill(server: Server, agent: str) -> None:
    """kill -9 of the agent's execution."""
    [execution] = executions_of(server, agent)
    os.kill(execution["pid"], signal.SIGKILL)


def restart(server: Server, agent: str) -> None:
    """Save and end the agent's executions, and wait for it."""
    transport(server).stop(agent, "restart")
    wait_for(lambda: not executions_of(server, agent), what="the execution to end")


def test_acting_goes_on_while_the_disk_is_full(own: Server, agent: Agent) -> None:
    identity, key = agent("full disk")
    with small_disk(own.data / "saves" / identity, 2), Client(key, own.url) as client:
        session, saves = client.session(), saves_of(own, identity)
        before = play_until_saved(session, saves)
        filler = fill(own.data / "saves" / identity)
        play(session, 2 * INTERVAL)
        expect_error(own, identity, "could not save")
        assert newest(saves) == before
        kill(own, identity)
        play(session, INTERVAL // 2)
        filler.unlink()
        restart(own, identity)
        assert before < newest(saves) <= before + INTERVAL // 2
        play(session, 20)


def test_acting_goes_on_while_the_folder_of_saves_cannot_be_written(own: Server, agent: Agent) -> None:
    identity, key = agent("unwritable")
    with Client(key, own.url) as client:
        session, saves = client.session(), saves_of(own, identity)
        before = play_until_saved(session, saves)
        folder = folder_of(own, saves)
        hidden = folder.with_name("hidden")
        folder.rename(hidden)
        folder.touch()  # a file instead: root may write to any folder
        play(session, 2 * INTERVAL)
        expect_error(own, identity, "could not save")
        folder.unlink()
        hidden.rename(folder)
        play_until_saved(session, saves, before)


def test_a_save_that_was_cut_in_half_is_passed_over(own: Server, agent: Agent) -> None:
    identity, key = agent("halved")
    with Client(key, own.url) as client:
        session, saves = client.session(), saves_of(own, identity)
        older = play_until_saved(session, saves)
        halved = play_until_saved(session, saves, older)
        restart(own, identity)
        halved = newest(saves)
        for name in [name for name, meta in saves.metas() if meta.steps > older]:
            model = folder_of(own, saves) / name / MODEL
            os.truncate(model, model.stat().st_size // 2)
        assert newest(saves) == older
        play(session, 40)
        restart(own, identity)
        assert older < newest(saves) <= older + 40 < halved


def test_what_a_killed_save_left_is_cleared_away(own: Server, agent: Agent) -> None:
    identity, key = agent("halved")
    with Client(key, own.url) as client:
        saves = saves_of(own, identity)
        left = folder_of(own, saves) / "1700000000.000000-12345678-99"
        left.mkdir(parents=True)
        (left / MODEL).write_bytes(b"half")
        os.utime(left, (1_700_000_000, 1_700_000_000))
        play(client.session(), 40)
        restart(own, identity)
    assert not left.exists()
    shutil.rmtree(left, ignore_errors=True)
