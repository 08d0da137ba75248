"""Who did what in the administration: Django's LogEntry, and the log-ins that django-axes keeps."""

from __future__ import annotations

from datetime import timedelta
from typing import Any

import structlog
from axes.models import AccessAttempt, AccessLog
from django.conf import settings
from django.contrib.admin.models import LogEntry
from django.db.models.signals import post_save
from django.dispatch import receiver
from django.utils import timezone

log = structlog.get_logger("shepherd.audit")


@receiver(post_save, sender=LogEntry)
def write_line(sender: type[LogEntry], instance: LogEntry, created: bool, **_: Any) -> None:
    """Every action is also a line of the log, which outlives the rows: those of a user who is deleted go with the user."""
    if created:
        log.info(
            "admin action",
            user=instance.user_id,
            action=instance.get_action_flag_display(),
            model=instance.content_type.model if instance.content_type else None,
            object=instance.object_id,
            what=instance.get_change_message(),
        )


def forget_old() -> None:
    """Delete what is older than SHEPHERD_AUDIT_DAYS, and wrong passwords that lock nobody out any more."""
    now = timezone.now()
    end = now - timedelta(days=settings.AUDIT_DAYS)
    LogEntry.objects.filter(action_time__lt=end).delete()
    AccessLog.objects.filter(attempt_time__lt=end).delete()
    AccessAttempt.objects.filter(attempt_time__lt=now - 2 * settings.AXES_COOLOFF_TIME).delete()
