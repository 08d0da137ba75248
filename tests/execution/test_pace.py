"""While a long update is made, decisions come one after the other at a pace, and ever slower towards the bound of the lead."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from envs_app.execution import worker
from tests.execution.station import Station

LONG = {"n_steps": 128}  # a rollout whose update is long


@pytest.fixture
def updating(tmp_path: Path) -> Iterator[Station]:
    """An execution amid an update."""
    with Station(tmp_path, parameters=LONG) as station:
        station.hold_learner()
        station.worker.learner.updating = True
        yield station


def test_the_next_decision_is_not_due_at_once(updating: Station, monkeypatch: pytest.MonkeyPatch) -> None:
    updating.step()
    monkeypatch.setattr(worker, "PACE_SECONDS", 60.0)
    monkeypatch.setattr(worker, "BRAKE_SECONDS", 60.0)
    parked = updating.post()
    updating.desk.wake()
    assert parked not in updating.answers
    due = updating.desk.next_due()
    assert due is not None and 50 < due <= 60


def test_it_is_taken_when_it_is_due(updating: Station) -> None:
    updating.step()
    assert updating.step()["k"] == "answer"
    assert updating.step(terminated=True)["episode"]["length"] == 2


def test_it_is_taken_as_soon_as_the_update_is_made(updating: Station, monkeypatch: pytest.MonkeyPatch) -> None:
    updating.step()
    monkeypatch.setattr(worker, "PACE_SECONDS", 60.0)
    monkeypatch.setattr(worker, "BRAKE_SECONDS", 60.0)
    parked = updating.post()
    updating.worker.learner.updating = False
    updating.desk.wake()
    assert updating.answers[parked]["k"] == "answer"


def test_the_pace_slows_towards_the_bound(updating: Station) -> None:
    paces = []
    for backlog in (0, updating.worker.allowed_lead // 2, updating.worker.allowed_lead):
        updating.worker.feed._items.extend([None] * (backlog - updating.worker.feed.backlog))
        paces.append(updating.worker.pace())
    assert paces[0] == worker.PACE_SECONDS < paces[1] < paces[2] == worker.BRAKE_SECONDS
    updating.worker.feed._items.clear()


def test_short_updates_and_learning_switched_off_slow_nobody(tmp_path: Path) -> None:
    with Station(tmp_path, parameters=LONG | {"n_steps": 32}) as station:
        station.worker.learner.updating = True
        assert station.worker.pace() == 0
    with Station(tmp_path, parameters=LONG) as station:
        station.worker.learner.updating = True
        station.worker.set_learning(False)
        assert station.worker.pace() == 0
        assert station.desk.next_due() is None


def test_the_learner_says_when_it_updates(tmp_path: Path) -> None:
    seen = set()
    with Station(tmp_path, parameters=LONG) as station:
        for _ in range(400):
            station.step()
            seen.add(station.worker.learner.updating)
        station.wait_until(lambda: not station.worker.learner.updating, "the end of the updates")
    assert seen == {True, False}
