"""Who did what, and who tried to log in: superusers read it, and nobody edits it."""

from __future__ import annotations

from math import ceil
from typing import Any

from axes.models import AccessAttempt, AccessLog
from django.conf import settings
from django.contrib import admin
from django.contrib.admin.models import LogEntry
from django.db.models import Model
from django.http import HttpRequest, HttpResponse
from django.shortcuts import render
from unfold.decorators import display
from unfold.paginator import InfinitePaginator

from agents_app.admin.owned import ReadOnlyAdmin


class AuditAdmin(ReadOnlyAdmin):
    """For superusers alone."""

    paginator = InfinitePaginator
    show_full_result_count = False

    def owns(self, request: HttpRequest, obj: Model | None) -> bool:
        """Superusers."""
        return super().owns(request, obj) and bool(request.user.is_superuser)


@admin.register(LogEntry)
class LogEntryAdmin(AuditAdmin):
    """Everything that was done in the admin, special actions and keys included."""

    list_display = ("action_time", "user", "content_type", "object_repr", "what")
    list_filter: Any = ("action_flag", "content_type")
    list_select_related = ("user", "content_type")
    search_fields = ("object_repr", "user__name")
    ordering = ("-action_time",)
    fields = readonly_fields = ("action_time", "user", "content_type", "object_id", "object_repr", "what")

    @display(description="What was done")
    def what(self, entry: LogEntry) -> str:
        """In words."""
        return entry.get_change_message() or entry.get_action_flag_display()


class AccessAdmin(AuditAdmin):
    """Who came to the log-in, when and from where."""

    search_fields = ("username", "ip_address")
    ordering = ("-attempt_time",)


@admin.register(AccessLog)
class AccessLogAdmin(AccessAdmin):
    """Log-ins."""

    list_display = ("attempt_time", "username", "ip_address", "logout_time")
    fields = readonly_fields = (*list_display, "user_agent")


@admin.register(AccessAttempt)
class AccessAttemptAdmin(AccessAdmin):
    """Wrong passwords. Who deletes a row lets its address try again at once."""

    list_display = ("attempt_time", "username", "ip_address", "failures_since_start")
    fields = readonly_fields = (*list_display, "user_agent")

    def has_delete_permission(self, request: HttpRequest, obj: Model | None = None) -> bool:
        """Superusers."""
        return self.owns(request, obj)


def locked_out(request: HttpRequest, response: HttpResponse, credentials: dict[str, Any]) -> HttpResponse:
    """The page that a locked-out person gets, in place of the log-in."""
    seconds = settings.AXES_COOLOFF_TIME.total_seconds()
    context = {"minutes": ceil(seconds / 60), "limit": settings.AXES_FAILURE_LIMIT}
    page = render(request, "agents_app/admin/locked_out.html", context, status=429)
    page["Retry-After"] = str(ceil(seconds))
    return page
