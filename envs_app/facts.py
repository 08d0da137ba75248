"""What the database says of an open session, to see whether it says the same as before.

Django makes the SQL of a query anew each time that it is asked: some 4 ms for what a handle needs, where the database takes a
twentieth of a millisecond. Most sessions are those of people, who think for longer than a handle is fresh; so nearly each of
their steps asks. Here the SQL is made once, and nobody reads the answer: it is compared.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from django.db import connection, models
from django.db.models import OuterRef, Subquery

from agents_app.models import Agent, APIKey, Run, Session

NOTED = {"last_activity_at", "last_used_at"}  # these change because somebody steps, and change nothing for a step
HASH = "the hash of the session key"  # in the query that is made once


def facts_of(key_hash: str) -> tuple[Any, ...] | None:
    """All that a handle may depend on, as the database has it; None where the session is closed, or never was."""
    sql, parameters = _query()
    with connection.cursor() as cursor:
        cursor.execute(sql, [key_hash if it == HASH else it for it in parameters])
        return cursor.fetchone()


@cache
def _query() -> tuple[str, tuple[Any, ...]]:
    """The SQL and its parameters. Nearly every field of the agent and of the key: what a handle needs one day is among them."""
    run = Run.objects.filter(agent=OuterRef("agent")).order_by("-number").values("pk")[:1]
    names = [*_names("agent", Agent), *_names("api_key", APIKey), "agent__owner__is_active"]
    sessions = Session.objects.filter(hash=HASH, closed_at=None).order_by().annotate(run=Subquery(run))
    return sessions.values_list("pk", "run", *names).query.sql_with_params()


def _names(path: str, model: type[models.Model]) -> list[str]:
    return [f"{path}__{field.attname}" for field in model._meta.concrete_fields if field.attname not in NOTED]
