"""Runs, executions, sessions, returns, saves and errors in the admin: to read."""

from __future__ import annotations

from typing import Any

from django.contrib import admin
from django.template.defaultfilters import filesizeformat
from django.urls import reverse
from django.utils.html import format_html
from unfold.decorators import display
from unfold.paginator import InfinitePaginator

from agents_app.admin.owned import ReadOnlyAdmin
from agents_app.models import EpisodeReturn, Execution, ExecutionError, Run, Save, Session


class OfARun(ReadOnlyAdmin):
    """Rows that belong to a run of an agent."""

    owner_path = "run__agent__owner"
    list_select_related: tuple[str, ...] = ("run__agent",)
    search_fields: tuple[str, ...] = ("run__agent__name",)


@admin.register(Run)
class RunAdmin(ReadOnlyAdmin):
    """Learning histories; the curve of each is on its agent's page."""

    owner_path = "agent__owner"
    list_display = ("__str__", "agent", "number", "started_at", "ended_at", "curve")
    list_select_related = ("agent",)
    search_fields = ("agent__name",)
    fields = readonly_fields = ("agent", "number", "started_at", "ended_at", "curve")
    ordering = ("-started_at",)

    @display(description="Curve")
    def curve(self, run: Run) -> str:
        """A link to the agent's page, with this run chosen."""
        url = reverse("admin:agents_app_agent_change", args=[run.agent_id])
        return format_html('<a class="shepherd-link" href="{}?run={}">Show</a>', url, run.number)


@admin.register(Execution)
class ExecutionAdmin(OfARun):
    """Worker processes, live and past."""

    list_display = ("__str__", "run", "started_at", "ended_at", "end_reason")
    list_filter = ("end_reason", ("ended_at", admin.EmptyFieldListFilter))
    ordering = ("-started_at",)


@admin.register(Session)
class SessionAdmin(ReadOnlyAdmin):
    """Conversations of clients."""

    owner_path = "agent__owner"
    list_display = ("__str__", "agent", "api_key", "created_at", "last_activity_at", "closed_at")
    list_filter = (("closed_at", admin.EmptyFieldListFilter),)
    list_select_related = ("agent", "api_key")
    search_fields = ("agent__name",)
    fields = readonly_fields = ("agent", "api_key", "created_at", "last_activity_at", "closed_at")


@admin.register(EpisodeReturn)
class EpisodeReturnAdmin(OfARun):
    """There may be millions: they are leafed through and never counted."""

    list_display = ("rounded", "length", "run", "execution", "learning", "created_at")
    list_filter = ("learning",)
    list_select_related = ("run__agent", "execution")
    ordering = ("-id",)
    sortable_by = ()
    search_fields = ()
    paginator = InfinitePaginator
    show_full_result_count = False
    fields = readonly_fields = ("run", "execution", "session", "episode", "value", "length", "learning", "created_at")

    @display(description="Return")
    def rounded(self, each: EpisodeReturn) -> str:
        """For people."""
        return f"{each.value:.6g}"


@admin.register(Save)
class SaveAdmin(OfARun):
    """Checkpoints."""

    list_display = ("name", "run", "steps", "mean_return", "bytes", "created_at")

    @display(description="Size", ordering="size")
    def bytes(self, save: Save) -> Any:
        """For people."""
        return filesizeformat(save.size)


@admin.register(ExecutionError)
class ExecutionErrorAdmin(OfARun):
    """Failures inside executions."""

    list_display = ("summary", "run", "created_at")
    search_fields = ("summary", "run__agent__name")
    fields = readonly_fields = ("run", "execution_uid", "created_at", "summary", "trace")
    ordering = ("-created_at",)

    @display(description="Traceback")
    def trace(self, error: ExecutionError) -> str:
        """As Python wrote it."""
        return format_html('<pre class="shepherd-trace">{}</pre>', error.traceback)
