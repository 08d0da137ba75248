"""Who asks too often is told to wait: 429 `throttled`, with Retry-After."""

from __future__ import annotations

from django.conf import settings

from agents_app.models import APIKey
from envs_app.counters import get_counters, now
from envs_app.errors import Throttled

MINUTE = 60.0
PACE = 10.0  # seconds over which steps are counted: a limit that is counted by the minute means a minute of refusals


def count_wrong_key(address: str) -> None:
    """Count a wrong API key. Raises Throttled past SHEPHERD_WRONG_KEYS a minute.

    A right key is always let through, also from an address that waits: keys of 192 random bits cannot be guessed, and
    nobody shall lock out the others of a class room or behind a proxy. What is spared is the log and a looping client.
    """
    sentence = "Too many wrong API keys came from this address; wait, then check the key."
    _count(f"wrong:{address}", settings.WRONG_KEYS, MINUTE, sentence)


def count_login(key: APIKey, address: str) -> None:
    """Count a session that a key opens from an address. Raises Throttled."""
    limit = settings.PUBLISHABLE_LOGINS if key.publishable else settings.LOGINS
    sentence = f"This key opened {limit} sessions from this address within a minute, the most it may; keep them open."
    _count(f"login:{key.pk}:{address}", limit, MINUTE, sentence)


def count_step(of: str, per_minute: int, whose: str) -> None:
    """Count a step of a session, an address or a key; `whose` says it in words. Raises Throttled past so many a minute."""
    sentence = f"The API key takes at most {per_minute} steps a minute {whose}; repeat the step later."
    span = PACE if per_minute >= MINUTE else MINUTE  # of fewer steps, ten seconds have less than ten
    _count(f"step:{of}", int(per_minute * span / MINUTE), span, sentence)


def _count(name: str, limit: int, seconds: float, sentence: str) -> None:
    """Count `name`, and raise Throttled when it came more than `limit` times (0: as often as it likes) in `seconds`."""
    if limit and get_counters().add(name, seconds) > limit:
        raise Throttled(sentence, seconds - now() % seconds)
