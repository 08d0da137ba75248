"""System checks of Shepherd's settings. What does not even parse has stopped the start before (shepherd.env)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from django.conf import settings
from django.core.checks import CheckMessage, Error, Warning, register
from django.db import connection


@register()
def check_times(**_: Any) -> list[CheckMessage]:
    """The times fit each other."""
    found: list[CheckMessage] = []
    if settings.RECLAIM_SECONDS <= settings.STEP_TIMEOUT:
        text = "A session could lose its execution while its step is being answered."
        hint = "Set SHEPHERD_RECLAIM_SECONDS above SHEPHERD_STEP_TIMEOUT."
        found.append(Error(text, hint=hint, id="shepherd.E001"))
    if settings.IDLE_SECONDS < settings.RECLAIM_SECONDS:
        text = "Executions are ended as idle before another session may take them over."
        hint = "Set SHEPHERD_IDLE_SECONDS to SHEPHERD_RECLAIM_SECONDS or more."
        found.append(Warning(text, hint=hint, id="shepherd.W001"))
    return found


@register()
def check_scale(**_: Any) -> list[CheckMessage]:
    """What machines share is where all of them reach it."""
    found: list[CheckMessage] = []
    redis, sqlite = settings.TRANSPORT == "redis", connection.vendor == "sqlite"
    if redis and not settings.REDIS_URL:
        hint = "Set REDIS_URL, or leave SHEPHERD_TRANSPORT away."
        found.append(Error("SHEPHERD_TRANSPORT is redis, and there is no Redis.", hint=hint, id="shepherd.E002"))
    if redis and sqlite:
        text = "Executions run on any machine, but the database is a file of this one."
        found.append(Warning(text, hint="Set DATABASE_URL to a PostgreSQL.", id="shepherd.W003"))
    return found


@register(deploy=True)
def check_secrets(**_: Any) -> list[CheckMessage]:
    """Nobody else on this machine reads the generated secrets."""
    folder = Path(settings.DATA_DIR) / "secrets"
    readable = [path.name for path in folder.glob("*") if path.stat().st_mode & 0o077]
    if readable:
        hint = f"chmod 600 {folder}/*"
        text = f"Other users of this machine can read these secrets: {', '.join(sorted(readable))}."
        return [Warning(text, hint=hint, id="shepherd.W002")]
    return []
