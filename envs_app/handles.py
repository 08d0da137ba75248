"""What this process knows of open sessions: a handle of each that it meets, checked against the database every REFRESH_SECONDS.

A thread of its own asks the database. A step waits for it, but not long: while the database does not answer, steps go on with
what is known.
"""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

from django.db import Error, close_old_connections
from django.utils import timezone
from gymnasium import spaces

from agents_app.algorithms.registry import get_row
from agents_app.models import Agent, Session, hash_key
from agents_app.spaces import parse_space
from envs_app.errors import UnknownSession
from envs_app.executions import places
from envs_app.facts import facts_of
from envs_app.guards import Guard, guard_of
from envs_app.transports.base import Address, Claim

REFRESH_SECONDS = 2.0  # so long may a closed session or a revoked key go on
PATIENCE_SECONDS = 1.0  # that a step waits for the database, once
STALE_SECONDS = 60.0  # so long a handle serves while the database cannot be asked
HANDLES_KEPT = 20_000
ASKING = 4  # threads


@dataclass
class Handle:
    """What this process knows of an open session."""

    key: str  # the hash of the session key
    session: int
    agent: str
    run: int
    observation_space: spaces.Space
    actions: int | None  # how many, if the agent takes masks
    advised_actions: spaces.Space | None  # the action space, if the agent takes advice
    max_executions: int
    sessions_per_execution: int
    guard: Guard | None  # of the API key
    counted_in: str  # time zone by whose hours actions are counted; empty: they are not
    expires_at: datetime | None  # the API key
    facts: tuple[Any, ...] | None  # of which all this was made
    checked_at: float
    address: Address | None = None
    asked: Future[Handle] | None = None  # the database, and it has not answered yet

    def claim(self, waits: bool) -> Claim:
        """What the transport must know to find an execution."""
        return Claim(self.agent, self.run, self.session, self.max_executions, self.sessions_per_execution, waits)


class Handles:
    """The handles of this process, by the hash of the session key; the one used longest ago goes first."""

    def __init__(self) -> None:
        self._by_hash: OrderedDict[str, Handle] = OrderedDict()
        self._lock = threading.Lock()
        self._asking = ThreadPoolExecutor(ASKING, "sessions")

    def get(self, session_key: str) -> Handle:
        """A handle that is fresh enough. Raises UnknownSession, DatabaseError."""
        key = hash_key(session_key)
        handle = self._by_hash.get(key)
        if handle is None or (age := time.monotonic() - handle.checked_at) > STALE_SECONDS:
            return self._take(key, handle, load, key)
        return handle if age <= REFRESH_SECONDS else self._check(key, handle)

    def _check(self, key: str, known: Handle) -> Handle:
        """What the database says, or what is known if it does not say so in time."""
        asked, patience = known.asked, 0.0
        if asked is None:
            asked, patience = self._ask(key, known), PATIENCE_SECONDS
        try:
            fresh = self._take(key, known, asked.result, patience)
        except TimeoutError:
            return known
        except Error:
            self._ask(key, known)  # and nobody waits for it
            return known
        return fresh if time.monotonic() - fresh.checked_at <= REFRESH_SECONDS else self._check(key, fresh)

    def _ask(self, key: str, known: Handle) -> Future[Handle]:
        known.asked = self._asking.submit(_check_and_let_go, key, known)
        return known.asked

    def _take(self, key: str, known: Handle | None, find: Callable[..., Handle], *arguments: Any) -> Handle:
        """Keep what is found. Raises UnknownSession, and what `find` does."""
        try:
            fresh = find(*arguments)
        except UnknownSession:
            self.drop(key)
            raise
        if known is not None and known.run == fresh.run:
            fresh.address = known.address
        self._keep(key, fresh)
        return fresh

    def _keep(self, key: str, handle: Handle) -> None:
        with self._lock:
            self._by_hash[key] = handle
            self._by_hash.move_to_end(key)
            while len(self._by_hash) > HANDLES_KEPT:
                self._by_hash.popitem(last=False)

    def whereabouts(self, session_key: str) -> dict[str, Any]:
        """What a log line may say of the session: ids, and nothing that opens it."""
        handle = self._by_hash.get(hash_key(session_key))
        if handle is None:
            return {}
        execution = handle.address.uid if handle.address else None
        return {"session": handle.session, "execution": execution, "agent": handle.agent}

    def renew(self, handle: Handle) -> None:
        """Take over what the database says now: an execution must not be sought for a run that is over."""
        fresh = check(handle.key, handle)
        handle.run, handle.facts, handle.checked_at = fresh.run, fresh.facts, fresh.checked_at
        handle.max_executions, handle.sessions_per_execution = fresh.max_executions, fresh.sessions_per_execution
        self._keep(handle.key, handle)

    def drop(self, key: str) -> None:
        """Forget a session."""
        with self._lock:
            self._by_hash.pop(key, None)

    def expire(self) -> None:
        """Have every handle checked again before its next step: something was revoked in this process."""
        for handle in list(self._by_hash.values()):
            handle.checked_at -= REFRESH_SECONDS
            handle.asked = None


handles = Handles()


def _check_and_let_go(key_hash: str, known: Handle) -> Handle:
    """In a thread that keeps no connection to the database."""
    try:
        return check(key_hash, known)
    finally:
        close_old_connections()


def check(key_hash: str, known: Handle) -> Handle:
    """The handle as it is known, if the database says what it said before, or else anew. Raises UnknownSession."""
    now = time.monotonic()
    expired = known.expires_at is not None and known.expires_at <= timezone.now()
    if expired or facts_of(key_hash) != known.facts:
        return load(key_hash)
    return replace(known, checked_at=now, asked=None)


def load(key_hash: str) -> Handle:
    """The handle of an open session, from the database. Raises UnknownSession."""
    facts = facts_of(key_hash)  # first: what changes meanwhile is seen the next time
    related = ("agent__algorithm", "agent__owner", "api_key")
    session = Session.objects.select_related(*related).filter(hash=key_hash, closed_at=None).first()
    if session is None or not session.api_key.is_valid() or not session.agent.owner.is_active:
        raise UnknownSession
    agent: Agent = session.agent
    row = get_row(agent.algorithm.name)
    advised = row.advice and agent.advice_method != Agent.AdviceMethod.NONE
    return Handle(
        key=key_hash,
        session=session.pk,
        agent=str(agent.pk),
        run=agent.current_run().pk,
        observation_space=parse_space(agent.observation_space),
        actions=agent.action_space if agent.takes_masks else None,
        advised_actions=parse_space(agent.action_space) if advised else None,
        max_executions=agent.max_executions,
        sessions_per_execution=places(agent),
        guard=guard_of(session.api_key),
        counted_in=agent.counted_in,
        expires_at=session.api_key.expires_at,
        facts=facts,
        checked_at=time.monotonic(),
    )
