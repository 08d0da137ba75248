"""The form in which an agent's owner makes an API key."""

from __future__ import annotations

from datetime import timedelta
from typing import Any

from django import forms
from django.core.exceptions import ValidationError
from django.utils import timezone

from agents_app.models import Agent, APIKey
from agents_app.origins import read_origins

PUBLISHABLE = "publishable"


class RenewalForm(forms.Form):
    """For how long the old key goes on beside the new one."""

    days = forms.IntegerField(min_value=0, max_value=365)


def sentences_of(form: forms.Form) -> str:
    """What is wrong with a form, for a message."""
    return " ".join(str(sentence) for sentences in form.errors.values() for sentence in sentences)


class KeyForm(forms.Form):
    """What kind of key, and for how long."""

    name = forms.CharField(max_length=100, required=False)
    scope = forms.ChoiceField(
        choices=[
            (APIKey.Scope.MANAGE, APIKey.Scope.MANAGE.label),
            (APIKey.Scope.STEP, APIKey.Scope.STEP.label),
            (PUBLISHABLE, "Publishable: step from your web pages, where everybody can read it"),
        ]
    )
    origins = forms.CharField(max_length=2000, required=False)
    budget = forms.IntegerField(min_value=1, max_value=10**9, required=False)
    days = forms.IntegerField(min_value=1, max_value=3650, required=False)

    def clean_origins(self) -> list[str]:
        """Separated by spaces or commas."""
        return read_origins(self.cleaned_data["origins"].replace(",", " ").split())

    def clean(self) -> dict[str, Any]:
        """Only publishable keys have origins."""
        data = super().clean() or self.cleaned_data
        if data.get("origins") and data.get("scope") != PUBLISHABLE:
            raise ValidationError("Only publishable keys are bound to web pages: choose Publishable, or name no page.")
        return data

    def issue(self, agent: Agent) -> tuple[APIKey, str]:
        """The key, and its secret."""
        data = self.cleaned_data
        publishable = data["scope"] == PUBLISHABLE
        return APIKey.issue(
            agent,
            data["name"],
            APIKey.Scope.STEP if publishable else data["scope"],
            publishable=publishable,
            origins=data["origins"],
            steps_per_minute=data["budget"],
            expires_at=timezone.now() + timedelta(days=data["days"]) if data["days"] else None,
        )
