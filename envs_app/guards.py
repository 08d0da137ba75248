"""What a key asks of whoever steps with it, beyond being valid."""

from __future__ import annotations

from dataclasses import dataclass

from agents_app.models import APIKey
from envs_app.errors import Forbidden
from envs_app.requests import Caller


@dataclass(frozen=True, slots=True)
class Guard:
    """Stands before a publishable key: only pages of its origins, or of this server's own host, may use it.

    Browsers do not let a page lie about its origin, so that nobody's page can have its visitors use another's key. Programs
    can; against them a publishable key is as open as any text in a page.
    """

    origins: frozenset[str]

    def admit(self, caller: Caller) -> None:
        """Let the caller pass. Raises Forbidden."""
        origin = caller.origin
        if origin in self.origins or origin.partition("://")[2] == caller.host:
            return
        asked = f"from a page of {origin[:100]}" if origin else "from no page (the request has no Origin header)"
        raise Forbidden(
            f"This publishable key was used {asked}; it works only in pages of its own origins, which its owner names."
        )


def guard_of(key: APIKey) -> Guard | None:
    """The guard of a key; None for a secret one, whose holder may be anywhere."""
    return Guard(frozenset(key.origins)) if key.publishable else None
