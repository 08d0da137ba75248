"""Algorithms and their parameters in the admin: everybody reads, `manage.py fill_catalogue` writes."""

from __future__ import annotations

from django.contrib import admin
from unfold.admin import TabularInline
from unfold.decorators import display

from agents_app.admin.owned import ReadOnlyAdmin
from agents_app.models import Algorithm, Parameter


class ParameterInline(TabularInline):
    """The parameters of an algorithm."""

    model = Parameter
    fields = readonly_fields = ("name", "type", "default", "minimum", "maximum", "help_text")
    extra = 0
    can_delete = False
    has_add_permission = has_change_permission = has_delete_permission = lambda *_: False
    has_view_permission = lambda *_: True  # noqa: E731 - the page itself asks


@admin.register(Algorithm)
class AlgorithmAdmin(ReadOnlyAdmin):
    """What agents can be made of."""

    list_display = ("name", "acts", "advice", "listed", "description")
    list_filter = ("discrete", "continuous", "advice", "listed")
    search_fields = ("name", "description")
    inlines = [ParameterInline]

    @display(description="Acts on", label=True)
    def acts(self, algorithm: Algorithm) -> str:
        """Which actions it can choose."""
        kinds = [name for name, can in (("choices", algorithm.discrete), ("numbers", algorithm.continuous)) if can]
        return " and ".join(kinds)


@admin.register(Parameter)
class ParameterAdmin(ReadOnlyAdmin):
    """What can be set."""

    list_display = ("name", "algorithm", "type", "default", "help_text")
    list_filter = ("algorithm", "type")
    list_select_related = ("algorithm",)
    search_fields = ("name", "help_text")
