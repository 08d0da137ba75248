"""What a key asks of whoever uses it, beyond being valid: the page that it is used from, and how often."""

from __future__ import annotations

from dataclasses import dataclass

from django.conf import settings

from agents_app.models import APIKey
from envs_app.errors import Forbidden
from envs_app.requests import Caller
from envs_app.throttles import count_step


@dataclass(frozen=True, slots=True)
class Guard:
    """Stands before the steps of a key that is publishable or has a budget."""

    key: int
    origins: frozenset[str] | None  # of a publishable key
    steps_per_minute: int | None  # the key's budget

    def admit(self, caller: Caller, session: int) -> None:
        """Let the caller step in a session. Raises Forbidden or Throttled.

        The visitors of a café have one address, and one session each: whoever steps too often is refused first, and the steps
        that are refused are not counted as the others'.
        """
        if self.origins is not None:
            _check_origin(self.origins, caller)
            count_step(f"session:{session}", settings.PUBLISHABLE_SESSION_STEPS, "in this session")
            count_step(f"{self.key}:{caller.network}", settings.PUBLISHABLE_STEPS, "from this address")
        if self.steps_per_minute is not None:
            count_step(f"{self.key}:", self.steps_per_minute, "of all its clients together")


def guard_of(key: APIKey) -> Guard | None:
    """The guard of a key; None where there is nothing to ask, so that most steps are not held up."""
    if not key.publishable and key.steps_per_minute is None:
        return None
    return Guard(key.pk, frozenset(key.origins) if key.publishable else None, key.steps_per_minute)


def check_page(key: APIKey, caller: Caller) -> None:
    """A publishable key is used from its own pages. Raises Forbidden."""
    if key.publishable:
        _check_origin(frozenset(key.origins), caller)


def _check_origin(origins: frozenset[str], caller: Caller) -> None:
    """Only pages of these origins, or of this server's own host, may use a publishable key. Raises Forbidden.

    Browsers do not let a page lie about its origin, so that nobody's page can have its visitors use another's key. Programs
    can; against them a publishable key is as open as any text in a page.
    """
    origin = caller.origin
    if origin in origins or origin.partition("://")[2] == caller.host:
        return
    asked = f"from a page of {origin[:100]}" if origin else "from no page (the request has no Origin header)"
    raise Forbidden(
        f"This publishable key was used {asked}; it works only in pages of its own origins, which its owner names."
    )
