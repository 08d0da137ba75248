"""System checks of Shepherd's settings. What does not even parse has stopped the start before (shepherd.env)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from django.conf import settings
from django.core.checks import CheckMessage, Error, Warning, register
from django.core.files.storage import storages
from django.db import connection

from shepherd.env import FOLDER


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


@register()
def check_saves(**_: Any) -> list[CheckMessage]:
    """The storage of saves is there, and executions reach it. Whether it answers, the first save shows."""
    found: list[CheckMessage] = []
    if settings.TRANSPORT == "local" and folder_of_saves() != str(Path(settings.DATA_DIR) / "saves"):
        text = "Executions of the embedded set-up save in the data folder, and elsewhere nobody looks."
        hint = "Leave SHEPHERD_SAVES and SHEPHERD_SAVES_OPTIONS away, or set REDIS_URL."
        found.append(Error(text, hint=hint, id="shepherd.E003"))
    try:
        storages["saves"]
    except Exception as error:  # whatever its library raises
        hint = "Set SHEPHERD_SAVES to a class of an installed package, and SHEPHERD_SAVES_OPTIONS to what it takes."
        found.append(Error(f"The storage of saves cannot be used: {error}", hint=hint, id="shepherd.E004"))
    return found


def folder_of_saves() -> str:
    """The folder of saves; empty: they are elsewhere."""
    saves = settings.STORAGES["saves"]
    return saves["OPTIONS"].get("location", "") if saves["BACKEND"] == FOLDER else ""


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
