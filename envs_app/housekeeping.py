"""The database's part of housekeeping: what executions reported is written down, what is over is closed and cleared away.

Called every second by the supervisor of `manage.py serve`; everything here may be done twice.
"""

from __future__ import annotations

import threading
import time
from datetime import UTC, datetime, timedelta
from typing import Any

import structlog
from django.conf import settings
from django.db import transaction
from django.db.models import Q
from django.utils import timezone

from agents_app import audit, curves
from agents_app.models import Agent, Execution, ExecutionError, Run, Save, Session
from envs_app.fleet import TransportFleet
from envs_app.saves import clear_saves
from envs_app.transports.choice import get_transport

log = structlog.get_logger("shepherd.housekeeping")

GRACE = timedelta(seconds=15)  # a row is written before its execution is there
ERRORS_KEPT = 50  # of a run
ACTIVITY_EVERY = timedelta(minutes=1)
SLOW_SECONDS = 60.0
FORGET_AGAIN = timedelta(minutes=10)  # so long after its end, a session is forgotten again and again


class Keeper:
    """Remembers how far it has read the transport's events."""

    def __init__(self) -> None:
        self.read = 0
        self.slow_at = -SLOW_SECONDS  # of the monotonic clock: the other one may be set back
        self.lock = threading.Lock()

    def run_once(self) -> None:
        """One round. Raises ConnectionError when nobody can be asked, DatabaseError; the next round makes up for it."""
        with self.lock:
            transport = get_transport()
            transport.sweep()
            live = transport.status()  # before the events: whatever ended since then has told why
            while events := transport.events(self.read):
                self._write(events)
            note_lost(live)
            note_found(live)
            if time.monotonic() - self.slow_at > SLOW_SECONDS:
                self.slow_at = time.monotonic()
                note_activity(live)
                stop_deleted(live)
                close_old_sessions()
                forget_closed_sessions()
                curves.catch_up()
                audit.forget_old()

    def _write(self, events: list[dict[str, Any]]) -> None:
        with transaction.atomic():
            for event in events:
                write_event(event)
        for run in Run.objects.filter(pk__in={event["run"] for event in events if event["k"] == "saved"}):
            sync_saves(run)
        clear_saves_of_deleted({(event["agent"], event["run"]) for event in events if event["k"] in ("saved", "ended")})
        self.read = events[-1]["id"]


def write_event(event: dict[str, Any]) -> None:
    """An execution ended or failed."""
    at = datetime.fromtimestamp(event["at"], UTC)
    if event["k"] == "ended":
        rows = Execution.objects.filter(uid=event["uid"], ended_at=None)
        rows.update(ended_at=at, end_reason=event["reason"][:50])
        log.info("execution ended", execution=event["uid"], agent=event["agent"], reason=event["reason"])
    elif event["k"] == "error" and Run.objects.filter(pk=event["run"]).exists():
        known = ExecutionError.objects.filter(run_id=event["run"])
        if not known.filter(execution_uid=event["uid"], created_at=at).exists():
            where = {"run_id": event["run"], "execution_uid": event["uid"], "created_at": at}
            ExecutionError.objects.create(**where, summary=event["summary"][:500], traceback=event["traceback"])
        old = known.order_by("-created_at").values_list("pk", flat=True)[ERRORS_KEPT:]
        ExecutionError.objects.filter(pk__in=list(old)).delete()


def sync_saves(run: Run) -> None:
    """Have the rows of a run's saves say what the storage holds; one that cannot be reached is asked after the next save."""
    try:
        found = {save["name"]: save for save in TransportFleet().saves(run)}
    except ConnectionError as error:
        log.warning("the catalogue of saves is not up to date", run=run.pk, error=str(error))
        return
    with transaction.atomic():
        Save.objects.filter(run=run).exclude(name__in=found).delete()
        known = set(Save.objects.filter(run=run).values_list("name", flat=True))
        for name in found.keys() - known:
            save = found[name]
            fields = {key: save[key] for key in ("steps", "mean_return", "size", "created_at")}
            Save.objects.create(run=run, name=name, execution_uid=save["execution"], **fields)


def clear_saves_of_deleted(runs: set[tuple[str, int]]) -> None:
    """Executions save as they end, and so after their agent and its saves were deleted. Agents and runs, by their keys."""
    known = set(Run.objects.filter(pk__in={run for _, run in runs}).values_list("pk", flat=True))
    for agent, run in runs:
        if run not in known:
            try:
                clear_saves(f"{agent}/{run}")
            except ConnectionError as error:
                log.warning("saves of a deleted agent are left", agent=agent, run=run, error=str(error))


def stop_deleted(live: list[dict[str, Any]]) -> None:
    """End executions whose agent is gone: a step may have started one while it was being deleted."""
    agents = {execution["agent"] for execution in live}
    known = {str(pk) for pk in Agent.objects.filter(pk__in=agents).values_list("pk", flat=True)}
    for agent in agents - known:
        get_transport().stop(agent, "deleted")


def note_lost(live: list[dict[str, Any]]) -> None:
    """Executions that the parent no longer knows ended with it; also one of the future, for then the clock was set back."""
    uids, now = [execution["uid"] for execution in live], timezone.now()
    known_for_long = Q(started_at__lt=now - GRACE) | Q(started_at__gt=now + GRACE)
    lost = Execution.objects.filter(known_for_long, ended_at=None).exclude(uid__in=uids)
    runs = list(Run.objects.filter(executions__in=lost).distinct())
    if lost.update(ended_at=timezone.now(), end_reason="lost"):
        log.warning("executions were lost")
        for run in runs:  # what they saved last, nobody reported
            sync_saves(run)


def note_found(live: list[dict[str, Any]]) -> None:
    """Executions that were taken for lost, and speak again, did not end: their machine was cut off for a while."""
    found = Execution.objects.filter(end_reason="lost", uid__in=[execution["uid"] for execution in live])
    if live and found.exists():
        log.warning("executions were found again", executions=found.update(ended_at=None, end_reason=""))


def note_activity(live: list[dict[str, Any]]) -> None:
    """Sessions in the middle of a long episode are active."""
    sessions = [session for execution in live for session in execution["active_sessions"]]
    now = timezone.now()
    Session.objects.filter(pk__in=sessions, last_activity_at__lt=now - ACTIVITY_EVERY).update(last_activity_at=now)


def close_old_sessions() -> None:
    """Close sessions that have been silent for days."""
    limit = timezone.now() - timedelta(days=settings.SESSION_DAYS)
    for session in Session.objects.filter(closed_at=None, last_activity_at__lt=limit)[:1000]:
        Session.objects.filter(pk=session.pk, last_activity_at__lt=limit).update(closed_at=timezone.now())
        get_transport().forget(session.pk, str(session.agent_id))


def forget_closed_sessions() -> None:
    """Once more: the executions could not be told, perhaps, or another web process let the session step a moment longer."""
    for session in Session.objects.filter(closed_at__gt=timezone.now() - FORGET_AGAIN).only("agent_id"):
        get_transport().forget(session.pk, str(session.agent_id))


_keeper = Keeper()


def run_once() -> None:
    """One round of this process's keeper."""
    _keeper.run_once()
