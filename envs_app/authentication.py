"""Who asks: API keys, found by their hash. Session keys are the business of envs_app.sessions."""

from __future__ import annotations

from datetime import timedelta
from typing import Any, cast

import structlog
from django.utils import timezone
from rest_framework.authentication import BaseAuthentication
from rest_framework.permissions import BasePermission
from rest_framework.request import Request

from agents_app.models import APIKey, User, hash_key
from envs_app.errors import Forbidden, InvalidApiKey
from envs_app.guards import check_page
from envs_app.requests import Caller, read_bearer
from envs_app.throttles import count_wrong_key

log = structlog.get_logger("shepherd.http")

USED_EVERY = timedelta(minutes=1)  # how exact "last used" is; it costs a write


def find_api_key(secret: str | None, caller: Caller) -> APIKey:
    """The key with its agent, noted as used. Raises InvalidApiKey, Throttled after many wrong ones, or Forbidden."""
    key = _look_up(secret) if secret else None
    if key is None:
        count_wrong_key(caller.network)
        log.info("wrong API key", address=caller.network)
        raise InvalidApiKey(
            "The API key is unknown, revoked or expired; send a valid one as 'Authorization: Bearer <API key>'."
        )
    check_page(key, caller)
    _note_use(key)
    return key


class ApiKeyAuthentication(BaseAuthentication):
    """`Authorization: Bearer <API key>`: request.auth is the APIKey, request.user the agent's owner."""

    def authenticate(self, request: Request) -> tuple[User, APIKey]:
        """The owner and the key."""
        key = find_api_key(read_bearer(request._request), Caller(request._request))
        return key.agent.owner, key


def api_key_of(request: Request) -> APIKey:
    """The key that ApiKeyAuthentication found."""
    return cast(APIKey, request.auth)


class MayManage(BasePermission):
    """Only keys with the scope `manage`."""

    def has_permission(self, request: Request, view: Any) -> bool:
        """True, or Forbidden is raised, which says more than False."""
        if api_key_of(request).scope != APIKey.Scope.MANAGE:
            raise Forbidden("This API key may only step; use one with the scope 'manage', made in the admin.")
        return True


def _look_up(secret: str) -> APIKey | None:
    keys = APIKey.objects.select_related("agent__owner", "agent__algorithm")
    key = keys.filter(hash=hash_key(secret), agent__owner__is_active=True).first()
    return key if key and key.is_valid() else None


def _note_use(key: APIKey) -> None:
    now = timezone.now()
    if key.last_used_at is None or now - key.last_used_at > USED_EVERY:
        APIKey.objects.filter(pk=key.pk).update(last_used_at=now)
