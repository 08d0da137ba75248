"""Users in the admin: only a name is needed; staff get a password."""

from __future__ import annotations

from typing import Any

from django import forms
from django.contrib import admin
from django.contrib.auth import update_session_auth_hash
from django.contrib.auth.password_validation import validate_password
from django.db.models import Count, Model, QuerySet
from django.http import HttpRequest
from unfold.decorators import display
from unfold.widgets import UnfoldAdminPasswordWidget

from agents_app import services
from agents_app.admin.owned import DeletesMuch
from agents_app.models import User


class UserForm(forms.ModelForm):
    """A password is asked of staff alone, and stays as it is when the field is left empty."""

    new_password = forms.CharField(
        required=False,
        strip=False,
        widget=UnfoldAdminPasswordWidget(attrs={"autocomplete": "new-password"}),
        help_text="With it they log in to the admin. Empty: as it was.",
    )

    class Meta:
        model = User
        fields = ("name", "is_active", "is_staff", "is_superuser")

    def clean_new_password(self) -> str:
        """Refuse what the password rules refuse."""
        if password := self.cleaned_data["new_password"]:
            validate_password(password, self.instance)
        return password

    def clean(self) -> dict[str, Any] | None:
        """Staff have a password; a superuser is staff."""
        data = super().clean() or self.cleaned_data
        if not data.get("is_staff"):
            data["is_superuser"] = False
        elif not data.get("new_password") and not self.has_password():
            self.add_error("new_password", "Staff log in to the admin: give a password.")
        return data

    def has_password(self) -> bool:
        """Whether there is one already."""
        return bool(self.instance.pk) and self.instance.has_usable_password()

    def save(self, commit: bool = True) -> User:
        """Set the password, or take it away from who is no longer staff."""
        user = self.instance
        if not user.is_staff:
            user.set_unusable_password()
        elif password := self.cleaned_data["new_password"]:
            user.set_password(password)
        return super().save(commit)


@admin.register(User)
class UserAdmin(DeletesMuch):
    """Superusers manage users; other staff see themselves."""

    form = UserForm
    owner_path = "pk"
    fieldsets = [(None, {"fields": ("name", "is_active", "is_staff", "is_superuser", "new_password")})]
    conditional_fields = {"is_superuser": "is_staff == true", "new_password": "is_staff == true"}
    list_display = ("name", "role", "agent_count", "is_active", "created_at")
    list_filter = ("is_staff", "is_active")
    search_fields = ("name",)
    ordering = ("name",)
    actions = None

    def get_queryset(self, request: HttpRequest) -> QuerySet[User]:
        """With the number of agents."""
        return super().get_queryset(request).annotate(agents_owned=Count("agents"))

    def owns(self, request: HttpRequest, obj: Model | None) -> bool:
        """Everybody owns themselves."""
        return super().owns(request, None) and (obj is None or request.user.is_superuser or obj == request.user)

    def has_add_permission(self, request: HttpRequest) -> bool:
        """Superusers."""
        return self.owns(request, None) and bool(request.user.is_superuser)

    def has_change_permission(self, request: HttpRequest, obj: Model | None = None) -> bool:
        """Superusers."""
        return self.has_add_permission(request)

    def has_delete_permission(self, request: HttpRequest, obj: Model | None = None) -> bool:
        """Superusers, and nobody themselves."""
        return self.has_add_permission(request) and obj != request.user

    def get_fieldsets(self, request: HttpRequest, obj: User | None = None) -> Any:
        """Who may not change it sees no password field."""
        if self.has_change_permission(request, obj):
            return self.fieldsets
        return [(None, {"fields": ("name", "is_staff", "created_at")})]

    def save_model(self, request: HttpRequest, obj: User, form: forms.ModelForm, change: bool) -> None:
        """Who changes their own password stays logged in."""
        super().save_model(request, obj, form, change)
        if obj == request.user:
            update_session_auth_hash(request, obj)

    def delete_model(self, request: HttpRequest, obj: User) -> None:
        """With their agents, which have executions and saves."""
        for agent in obj.agents.all():
            services.delete_agent(agent)
        super().delete_model(request, obj)

    @display(description="Role", label={"superuser": "danger", "staff": "info", "user": "success"})
    def role(self, user: User) -> str:
        """What they may do."""
        return "superuser" if user.is_superuser else "staff" if user.is_staff else "user"

    @display(description="Agents", ordering="agents_owned")
    def agent_count(self, user: Any) -> int:
        """How many agents they own."""
        return user.agents_owned
