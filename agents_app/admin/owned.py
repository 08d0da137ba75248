"""Who may do what in the admin: staff see and touch what is theirs, superusers all. No permissions to hand out."""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce
from typing import Any

from django.contrib import messages
from django.db.models import ForeignKey, Model, QuerySet
from django.forms import ModelChoiceField
from django.http import HttpRequest, HttpResponse, HttpResponseRedirect
from django.urls import reverse
from unfold.admin import ModelAdmin

from agents_app.models import User


class OwnedAdmin(ModelAdmin):
    """The admin of a model whose rows belong to a user; `owner_path` leads there, '' is for what all may see."""

    owner_path = ""
    list_fullwidth = True
    list_per_page = 50

    def get_queryset(self, request: HttpRequest) -> QuerySet[Any]:
        """Only what the person owns. Every view, action, autocomplete and history of the admin starts from here."""
        rows = super().get_queryset(request)
        if self.owner_path and not request.user.is_superuser:
            rows = rows.filter(**{self.owner_path: request.user.pk})
        return rows

    def owns(self, request: HttpRequest, obj: Model | None) -> bool:
        """Whether the person is staff and the row, if it is one, is theirs."""
        user = request.user
        if not isinstance(user, User) or not (user.is_active and user.is_staff):
            return False
        if user.is_superuser or obj is None or not self.owner_path:
            return True
        return bool(reduce(getattr, self.owner_path.split("__"), obj) == user)

    def has_module_permission(self, request: HttpRequest) -> bool:
        """All staff see that there is such a thing."""
        return self.owns(request, None)

    def has_view_permission(self, request: HttpRequest, obj: Model | None = None) -> bool:
        """Owners."""
        return self.owns(request, obj)

    def has_add_permission(self, request: HttpRequest) -> bool:
        """All staff."""
        return self.owns(request, None)

    def has_change_permission(self, request: HttpRequest, obj: Model | None = None) -> bool:
        """Owners."""
        return self.owns(request, obj)

    def has_delete_permission(self, request: HttpRequest, obj: Model | None = None) -> bool:
        """Owners."""
        return self.owns(request, obj)

    def formfield_for_foreignkey(
        self, db_field: ForeignKey[Any, Any], request: HttpRequest, **kwargs: Any
    ) -> ModelChoiceField | None:
        """Choices are what the admin of the other model shows the person."""
        other = self.admin_site._registry.get(db_field.remote_field.model)
        if other is not None:
            kwargs["queryset"] = other.get_queryset(request)
        return super().formfield_for_foreignkey(db_field, request, **kwargs)


class ReadOnlyAdmin(OwnedAdmin):
    """Rows that the server writes and people read."""

    actions: Any = None

    def has_add_permission(self, request: HttpRequest) -> bool:
        """Nobody."""
        return False

    def has_change_permission(self, request: HttpRequest, obj: Model | None = None) -> bool:
        """Nobody."""
        return False

    def has_delete_permission(self, request: HttpRequest, obj: Model | None = None) -> bool:
        """Nobody."""
        return False


class DeletesMuch(OwnedAdmin):
    """The admin of a model whose rows have a million others below them, and executions that may live."""

    def get_deleted_objects(self, objs: Iterable[Model], request: HttpRequest) -> tuple[Any, Any, Any, Any]:
        """The question names what goes, and does not list it: names, counts, missing permissions, protected rows."""
        names = [f"{obj._meta.verbose_name}: {obj}, with everything that belongs to it" for obj in objs]
        return names, {type(obj)._meta.verbose_name_plural: len(names) for obj in objs}, set(), []

    def delete_view(
        self, request: HttpRequest, object_id: str, extra_context: dict[str, Any] | None = None
    ) -> HttpResponse:
        """Unless the executions cannot be ended."""
        try:
            return super().delete_view(request, object_id, extra_context)
        except ConnectionError as error:
            messages.error(request, f"Not deleted: the executions cannot be reached ({error}). Try again later.")
            page = f"admin:{self.opts.app_label}_{self.opts.model_name}_change"
            return HttpResponseRedirect(reverse(page, args=[object_id]))
