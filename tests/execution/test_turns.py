"""Learners take turns at long updates, and none of them can keep the others waiting for ever."""

from __future__ import annotations

import threading
import time
from pathlib import Path

from envs_app.execution.turns import PATIENCE, Turns


def test_as_many_train_at_once_as_may(tmp_path: Path) -> None:
    one, other, third = (Turns(tmp_path, 2) for _ in range(3))
    one.take()
    other.take()
    waiting = threading.Thread(target=third.take, daemon=True)
    waiting.start()
    waiting.join(0.1)
    assert waiting.is_alive()
    one.give_back()
    waiting.join(5)
    assert not waiting.is_alive()


def test_an_update_that_takes_minutes_keeps_nobody_waiting_so_long(tmp_path: Path) -> None:
    endless, patient = Turns(tmp_path, 1), Turns(tmp_path, 1, patience=0.1)
    endless.take()
    before = time.monotonic()
    patient.take()
    assert time.monotonic() - before >= 0.1
    patient.give_back()


def test_nobody_waits_who_is_ending(tmp_path: Path) -> None:
    endless, other = Turns(tmp_path, 1), Turns(tmp_path, 1)
    assert endless.take(lambda: True), "there was one"
    before = time.monotonic()
    assert not other.take(lambda: True)
    assert time.monotonic() - before < PATIENCE
    endless.give_back()


def test_without_a_folder_there_are_no_turns(tmp_path: Path) -> None:
    one, other = (Turns(tmp_path / "missing", 1) for _ in range(2))
    before = time.monotonic()
    one.take()
    other.take()  # there is one turn, and nobody waits for it
    assert time.monotonic() - before < PATIENCE
    one.give_back()
    other.give_back()
