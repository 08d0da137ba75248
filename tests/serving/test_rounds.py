"""The rounds of housekeeping, whatever the clock says."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from datetime import timedelta
from typing import Any

import pytest
from django.core.files.storage import InMemoryStorage
from django.utils import timezone

from agents_app.models import Run
from envs_app import housekeeping
from envs_app.execution.saves import SaveMeta
from envs_app.saves import prefix_of, saves_below
from tests.agents.makers import make_agent

pytestmark = pytest.mark.django_db
HOUR = timedelta(hours=1)


class Quiet:
    """A transport on which only that lives and happens that a test says."""

    def __init__(self) -> None:
        self.live: list[dict[str, Any]] = []
        self.happened: list[dict[str, Any]] = []
        self.stopped: list[tuple[str, str]] = []

    def sweep(self) -> None:
        """Nothing to sweep."""

    def status(self) -> list[dict[str, Any]]:
        """Who lives."""
        return self.live

    def events(self, after: int) -> list[dict[str, Any]]:
        """What happened since."""
        return [event for event in self.happened if event["id"] > after]

    def stop(self, agent: str, reason: str) -> None:
        """Keep what was asked for."""
        self.stopped.append((agent, reason))


@pytest.fixture(autouse=True)
def transport(monkeypatch: pytest.MonkeyPatch) -> Quiet:
    """Nothing runs."""
    quiet = Quiet()
    monkeypatch.setattr(housekeeping, "get_transport", lambda: quiet)
    return quiet


@pytest.fixture
def run() -> Run:
    """Of some agent."""
    return make_agent("kept").current_run()


@pytest.fixture
def set_back(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Sets the clock back an hour."""
    now = timezone.now
    return lambda: monkeypatch.setattr(housekeeping.timezone, "now", lambda: now() - HOUR)


def test_what_is_done_each_minute_is_done_though_the_clock_was_set_back(
    set_back: Callable[[], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    done, monotonic = [], [1000.0]
    monkeypatch.setattr(housekeeping, "close_old_sessions", lambda: done.append("closed"))
    monkeypatch.setattr("envs_app.housekeeping.time.monotonic", lambda: monotonic[0])
    keeper = housekeeping.Keeper()
    keeper.run_once()
    keeper.run_once()
    assert len(done) == 1
    set_back()
    monotonic[0] += 61.0
    keeper.run_once()
    assert len(done) == 2


def test_a_lost_execution_is_noted_though_the_clock_was_set_back(run: Run, set_back: Callable[[], None]) -> None:
    lost = run.executions.create(number=1)
    housekeeping.note_lost([])  # it may be starting
    lost.refresh_from_db()
    assert lost.ended_at is None
    set_back()
    housekeeping.note_lost([])
    lost.refresh_from_db()
    assert lost.end_reason == "lost"


def test_what_an_execution_saved_after_its_agent_was_deleted_goes(
    run: Run, transport: Quiet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("envs_app.saves.storages", {"saves": InMemoryStorage()})
    kept = make_agent("other").current_run()
    meta = SaveMeta("a" * 32, 1, 10, updates=1, episodes=1, mean_return=None)
    gone = prefix_of(run)
    for prefix in (gone, prefix_of(kept)):
        with saves_below(prefix) as store:
            store.write(meta, lambda model: model.write(b"model"))
    where = [{"agent": str(each.agent_id), "run": each.pk, "uid": str(uuid.uuid4()), "at": 0.0} for each in (run, kept)]
    transport.happened = [{"id": number, "k": "saved", "name": "", **each} for number, each in enumerate(where, 1)]
    run.agent.delete()
    housekeeping.Keeper().run_once()
    for prefix, count in ((gone, 0), (prefix_of(kept), 1)):
        with saves_below(prefix) as store:
            assert len(store.names()) == count


def test_an_execution_that_a_step_started_while_its_agent_was_deleted_ends(run: Run, transport: Quiet) -> None:
    gone, stays = str(uuid.uuid4()), str(run.agent_id)
    transport.live = [{"uid": str(uuid.uuid4()), "agent": agent, "active_sessions": []} for agent in (gone, stays)]
    housekeeping.Keeper().run_once()
    assert transport.stopped == [(gone, "deleted")]
