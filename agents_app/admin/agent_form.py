"""The form of an agent, with a field for each parameter of its algorithm; an empty field is the default."""

from __future__ import annotations

from typing import Any, ClassVar

from django import forms
from django.contrib.auth.models import AnonymousUser
from django.core.exceptions import ValidationError
from unfold.widgets import (
    UnfoldAdminIntegerFieldWidget,
    UnfoldAdminSelectWidget,
    UnfoldAdminTextareaWidget,
    UnfoldAdminTextInputWidget,
)

from agents_app import services
from agents_app.algorithms.policies import AUTO
from agents_app.models import Agent, Algorithm, Parameter, ParameterType, User
from agents_app.models.catalogue import check_value

PREFIX = "parameter_"
CHOICES = {True: "true", False: "false"}  # of a yes or no, as the page sends them
NO_JSON = {"invalid": "This cannot be read: write e.g. 4, or [[8], -10, 10]."}


class SpaceField(forms.JSONField):
    """A space, as JSON; what is no JSON is refused in words."""

    widget = UnfoldAdminTextareaWidget
    default_error_messages: ClassVar[dict[str, Any]] = NO_JSON

    def widget_attrs(self, widget: forms.Widget) -> dict[str, Any]:
        """Most are short."""
        return super().widget_attrs(widget) | {"rows": 2, "spellcheck": "false"}

    def prepare_value(self, value: Any) -> Any:
        """Nothing yet is nothing, not null."""
        return "" if value is None else super().prepare_value(value)


class AgentForm(forms.ModelForm):
    """An agent, checked as a whole with its parameters. `user` is set by the admin."""

    user: User | AnonymousUser
    action_space = SpaceField(help_text=Agent._meta.get_field("action_space").help_text)
    observation_space = SpaceField(help_text=Agent._meta.get_field("observation_space").help_text)
    action_features = SpaceField(help_text=Agent._meta.get_field("action_features").help_text, required=False)

    class Meta:
        model = Agent
        fields = ("owner", "name", "algorithm", "policy")  # the admin's fieldsets say the rest

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        """Staff own what they make."""
        super().__init__(*args, **kwargs)
        if "owner" not in self.fields and not self.instance.owner_id:
            self.instance.owner = self.user
        if "policy" in self.fields and self.instance.algorithm_id:
            policies = [AUTO, *self.instance.algorithm.policies]
            self.fields["policy"].widget = UnfoldAdminSelectWidget(choices=[(name, name) for name in policies])
        if "advisor" in self.fields:
            self.fields["advisor"].queryset = services.possible_advisors(self.instance)  # type: ignore[attr-defined]
        for name, value in self.instance.own_parameters().items() if self.instance.pk else ():
            self.initial[PREFIX + name] = CHOICES[value] if isinstance(value, bool) else value

    def parameters(self) -> dict[str, Any]:
        """The owner's values by parameter name; None for the default."""
        named = {name.removeprefix(PREFIX): self.cleaned_data[name] for name in self.fields if name.startswith(PREFIX)}
        return {name: None if value in (None, "") else value for name, value in named.items()}

    def _get_validation_exclusions(self) -> set[str]:
        """Names are unique per owner, whoever that is."""
        return super()._get_validation_exclusions() - {"owner"}  # type: ignore[misc]

    def _post_clean(self) -> None:
        """After the agent itself, its parameters, which may not suit it."""
        super()._post_clean()  # type: ignore[misc]
        if self.errors or not self.instance.algorithm_id:
            return
        try:
            services.check_parameters(self.instance, self.parameters())
        except ValidationError as error:
            for name, sentences in error.message_dict.items():
                self.add_error(PREFIX + name, sentences)


def form_for(user: User | AnonymousUser, algorithm: Algorithm | None) -> type[AgentForm]:
    """The form with a field per parameter."""
    parameters = algorithm.parameters.all() if algorithm else []
    fields = {PREFIX + parameter.name: field_for(parameter) for parameter in parameters}
    return type("AgentForm", (AgentForm,), {"user": user, **fields})


def field_for(parameter: Parameter) -> forms.Field:
    """A field of the parameter's type. Its placeholder is the default."""
    shown = describe(parameter.default)
    options: dict[str, Any] = {"label": parameter.name, "required": False, "help_text": parameter.help_text}
    options["validators"] = [lambda value: check_value(parameter, value)]
    placeholder = {"placeholder": f"default: {shown}"}
    if parameter.type == ParameterType.BOOL:
        choices = [("", f"default: {shown}"), (CHOICES[True], "yes"), (CHOICES[False], "no")]
        widget = UnfoldAdminSelectWidget(choices=choices)
        return forms.TypedChoiceField(
            coerce=CHOICES[True].__eq__, empty_value=None, choices=choices, widget=widget, **options
        )
    if parameter.type == ParameterType.INT:
        return forms.IntegerField(widget=UnfoldAdminIntegerFieldWidget(attrs=placeholder), **options)
    if parameter.type == ParameterType.FLOAT:
        return forms.FloatField(widget=UnfoldAdminTextInputWidget(attrs=placeholder), **options)
    return forms.CharField(widget=UnfoldAdminTextInputWidget(attrs=placeholder), max_length=500, **options)


def describe(default: Any) -> str:
    """A default for people."""
    if default in (None, ""):
        return "none"
    return {True: "yes", False: "no"}[default] if isinstance(default, bool) else str(default)
