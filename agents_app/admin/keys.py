"""API keys in the admin. They are made on the agent's page, shown once, and revoked; never edited."""

from __future__ import annotations

from typing import Any

from django.contrib import admin, messages
from django.db.models import QuerySet
from django.http import HttpRequest
from unfold.decorators import display

from agents_app import services
from agents_app.admin.owned import ReadOnlyAdmin
from agents_app.models import APIKey


@admin.register(APIKey)
class APIKeyAdmin(ReadOnlyAdmin):
    """All keys of all one's agents."""

    owner_path = "agent__owner"
    list_display = ("prefix", "name", "agent", "kind", "state", "created_at", "last_used_at", "expires_at")
    list_filter = ("scope", ("revoked_at", admin.EmptyFieldListFilter))
    list_select_related = ("agent",)
    search_fields = ("name", "prefix", "agent__name")
    fields: Any = ("agent", "name", "prefix", "kind", "published", "state", "created_at", "last_used_at", "expires_at")
    fields += ("steps_per_minute", "successor", "revoked_at")
    readonly_fields = ("kind", "published", "state")
    actions = ["revoke"]

    @admin.action(description="Revoke: no client gets in with them any more")
    def revoke(self, request: HttpRequest, keys: QuerySet[APIKey]) -> None:
        """Close them, and the sessions that they opened."""
        for key in keys:
            services.revoke_key(key)
            self.log_change(request, key, "Revoked")
        messages.success(request, f"{len(keys)} revoked.")

    @display(description="Scope", ordering="scope")
    def kind(self, key: APIKey) -> str:
        """What it may do, and from where."""
        return key.describe_scope()

    @display(description="State", label={"valid": "success", "revoked": "danger", "expired": "warning"})
    def state(self, key: APIKey) -> str:
        """Whether it opens its agent."""
        return "valid" if key.is_valid() else "revoked" if key.revoked_at else "expired"
