"""What must outlive an execution does, however often its file is closed and opened again."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from envs_app.execution.ledger import FileLedger, SessionState

STATE = SessionState("uid", 7, "request", {"k": "answer", "action": [0.5, 1.0]}, True, 3, -2.5, 40)


def test_a_session_that_never_stepped_has_a_blank_state(tmp_path: Path) -> None:
    assert FileLedger(tmp_path).load(1) == SessionState()


def test_a_state_is_read_by_another_process(tmp_path: Path) -> None:
    FileLedger(tmp_path).store(1, STATE)
    assert FileLedger(tmp_path).load(1) == STATE


def test_the_newest_state_is_loaded_whoever_wrote_it_last(tmp_path: Path) -> None:
    for number in range(1, 6):
        ledger = FileLedger(tmp_path)  # a new process
        assert ledger.load(1).seq == (number - 1 or None)
        ledger.close(1)  # as when the session is taken over from an execution that is no more
        ledger.store(1, SessionState(seq=number))
        assert ledger.load(1).seq == number


def test_two_processes_see_what_the_other_wrote_last(tmp_path: Path) -> None:
    one, other = FileLedger(tmp_path), FileLedger(tmp_path)
    for number in range(1, 7):
        (one if number % 3 else other).store(1, SessionState(seq=number))
        assert one.load(1).seq == other.load(1).seq == number


def test_a_file_closed_to_save_descriptors_is_written_on(tmp_path: Path) -> None:
    ledger = FileLedger(tmp_path)
    for number in range(1, 4):
        for session in range(ledger.OPEN + 1):
            ledger.store(session, SessionState(seq=number))
    assert all(ledger.load(session).seq == 3 for session in range(ledger.OPEN + 1))


@settings(max_examples=60, deadline=None)
@given(at=st.integers(0, 2 * 4096 - 1), garbage=st.binary(min_size=1, max_size=200))
def test_a_torn_write_never_gives_a_state_that_was_not_stored(
    tmp_path_factory: pytest.TempPathFactory, at: int, garbage: bytes
) -> None:
    folder = tmp_path_factory.mktemp("torn")
    ledger = FileLedger(folder)
    for number in (1, 2):
        ledger.store(1, SessionState(seq=number))
    with (folder / "1").open("r+b") as file:
        file.seek(at)
        file.write(garbage)
    assert FileLedger(folder).load(1) in (SessionState(), SessionState(seq=1), SessionState(seq=2))


def test_a_torn_slot_leaves_the_state_before(tmp_path: Path) -> None:
    ledger = FileLedger(tmp_path)
    for number in range(1, 5):
        ledger.store(1, SessionState(seq=number))
        with (tmp_path / "1").open("r+b") as file:
            file.seek(ledger.slot * ((number + 1) % 2) + FileLedger.HEADER.size + 1)
            file.write(b"\xff\xff")  # the next one, as if the process had died while it wrote
        assert FileLedger(tmp_path).load(1).seq == number


class TestFullDisk:
    @pytest.fixture
    def full(self, monkeypatch: pytest.MonkeyPatch) -> Any:
        """Call it with True or False."""

        def refuse(*arguments: Any) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

        allocate = os.posix_fallocate
        return lambda yes: monkeypatch.setattr(os, "posix_fallocate", refuse if yes else allocate)

    def test_the_state_is_kept_in_memory(self, tmp_path: Path, full: Any) -> None:
        ledger = FileLedger(tmp_path)
        full(True)
        assert ledger.load(1) == SessionState()
        ledger.store(1, STATE)
        assert ledger.load(1) == STATE

    def test_it_goes_to_the_disk_when_there_is_room_again(self, tmp_path: Path, full: Any) -> None:
        ledger = FileLedger(tmp_path)
        full(True)
        ledger.store(1, SessionState(seq=1))
        full(False)
        ledger.store(1, SessionState(seq=2))
        assert FileLedger(tmp_path).load(1).seq == 2

    def test_a_state_that_is_too_large_for_its_slot_is_kept_in_memory(self, tmp_path: Path) -> None:
        ledger = FileLedger(tmp_path)
        large = SessionState(reply={"action": [0.123456789] * 2000})
        ledger.store(1, SessionState(seq=1))
        ledger.store(1, large)
        assert ledger.load(1) == large
        assert FileLedger(tmp_path).load(1).seq == 1
