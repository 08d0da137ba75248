"""A handle is checked by one question, and made anew when anything that it depends on has changed."""

from __future__ import annotations

from collections.abc import Callable
from datetime import timedelta
from typing import Any

import pytest
from django.utils import timezone

from agents_app.models import Agent, APIKey, Session, hash_key, make_key
from envs_app import handles
from envs_app.errors import UnknownSession

Change = Callable[[Session], Any]
SECRET = make_key("ss")
KEY = hash_key(SECRET)


def set_of(rows: Any, **values: Any) -> None:
    rows.update(**values)


OVER: dict[str, Change] = {
    "closed": lambda it: set_of(Session.objects, closed_at=timezone.now()),
    "revoked": lambda it: set_of(APIKey.objects, revoked_at=timezone.now()),
    "expired": lambda it: set_of(APIKey.objects, expires_at=timezone.now()),
    "owner gone": lambda it: set_of(type(it.agent.owner).objects, is_active=False),
    "deleted": lambda it: it.agent.delete(),
}
CHANGED: dict[str, tuple[Change, str, Any]] = {
    "executions": (lambda it: set_of(Agent.objects, max_executions=7), "max_executions", 7),
    "sessions": (lambda it: set_of(Agent.objects, sessions_per_execution=5), "sessions_per_execution", 5),
    "counted": (lambda it: set_of(Agent.objects, counted_in="Europe/Brussels"), "counted_in", "Europe/Brussels"),
    "budget": (lambda it: set_of(APIKey.objects, steps_per_minute=9), "guard.steps_per_minute", 9),
}


@pytest.fixture
def session(agent: Agent) -> Session:
    """An open session, whose run there is."""
    agent.current_run()
    return Session.objects.create(agent=agent, api_key=APIKey.issue(agent)[0], hash=KEY)


@pytest.fixture
def known(session: Session) -> handles.Handle:
    """What a web process knows of it."""
    return handles.load(KEY)


def test_what_did_not_change_is_one_question(
    known: handles.Handle, django_assert_num_queries: Callable[[int], Any]
) -> None:
    Agent.objects.update(last_activity_at=timezone.now())  # as others step
    APIKey.objects.update(last_used_at=timezone.now())
    with django_assert_num_queries(1):
        fresh = handles.check(KEY, known)
    assert fresh.checked_at > known.checked_at
    assert (fresh.run, fresh.facts) == (known.run, known.facts)


@pytest.mark.parametrize("how", OVER)
def test_what_is_over_opens_nothing(session: Session, known: handles.Handle, how: str) -> None:
    OVER[how](session)
    with pytest.raises(UnknownSession):
        handles.check(KEY, known)


def test_a_key_that_ran_out_meanwhile_opens_nothing(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    """Though nothing has changed in the database."""
    APIKey.objects.update(expires_at=timezone.now() + timedelta(minutes=1))
    known = handles.load(KEY)
    assert handles.check(KEY, known).facts == known.facts
    later = timezone.now() + timedelta(minutes=2)
    monkeypatch.setattr(timezone, "now", lambda: later)
    with pytest.raises(UnknownSession):
        handles.check(KEY, known)


@pytest.mark.parametrize("what", CHANGED)
def test_what_changed_is_taken_over(session: Session, known: handles.Handle, what: str) -> None:
    change, name, value = CHANGED[what]
    change(session)
    fresh: Any = handles.check(KEY, known)
    for part in name.split("."):
        fresh = getattr(fresh, part)
    assert fresh == value


def test_a_new_run_is_noticed(session: Session, known: handles.Handle) -> None:
    session.agent.runs.create(number=2)
    assert handles.check(KEY, known).run == session.agent.current_run().pk != known.run
