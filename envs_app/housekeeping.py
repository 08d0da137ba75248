"""The database's part of housekeeping: what executions reported is written down, what is over is closed and cleared away.

Called every second by the supervisor of `manage.py serve`; everything here may be done twice.
"""

from __future__ import annotations

import threading
from datetime import UTC, datetime, timedelta
from typing import Any

import structlog
from django.conf import settings
from django.db import transaction
from django.utils import timezone

from agents_app import audit, curves
from agents_app.models import Execution, ExecutionError, Run, Save, Session
from envs_app.fleet import TransportFleet
from envs_app.transports.choice import get_transport

log = structlog.get_logger("shepherd.housekeeping")

GRACE = timedelta(seconds=15)  # a row is written before its execution is there
ERRORS_KEPT = 50  # of a run
ACTIVITY_EVERY = timedelta(minutes=1)
SLOW_EVERY = timedelta(minutes=1)
FORGET_AGAIN = timedelta(minutes=10)  # so long after its end, a session is forgotten again and again


class Keeper:
    """Remembers how far it has read the transport's events."""

    def __init__(self) -> None:
        self.read = 0
        self.slow_at = datetime.min.replace(tzinfo=UTC)
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
            if timezone.now() - self.slow_at > SLOW_EVERY:
                self.slow_at = timezone.now()
                note_activity(live)
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


def note_lost(live: list[dict[str, Any]]) -> None:
    """Executions that the parent no longer knows ended with it."""
    uids = [execution["uid"] for execution in live]
    lost = Execution.objects.filter(ended_at=None, started_at__lt=timezone.now() - GRACE).exclude(uid__in=uids)
    runs = list(Run.objects.filter(executions__in=lost).distinct())
    if lost.update(ended_at=timezone.now(), end_reason="lost"):
        log.warning("executions were lost")
        for run in runs:  # what they saved last, nobody reported
            sync_saves(run)


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
