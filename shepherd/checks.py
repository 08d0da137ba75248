"""System checks of Shepherd's settings. What does not even parse has stopped the start before (shepherd.env)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from django.conf import settings
from django.core.checks import CheckMessage, Error, Warning, register


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
