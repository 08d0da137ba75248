"""The catalogue: algorithms, their parameters, and the values that agents give them."""

from __future__ import annotations

import math
import re
from typing import Any

from django.core.exceptions import ValidationError
from django.db import models
from django.db.models import Q


class Algorithm(models.Model):
    """A learning algorithm and what it can act on. Filled by `manage.py fill_catalogue`."""

    name = models.CharField(max_length=50, unique=True)
    description = models.TextField(blank=True)
    discrete = models.BooleanField(default=False, help_text="Can choose one of n actions.")
    continuous = models.BooleanField(default=False, help_text="Can choose a vector of real numbers.")
    advice = models.BooleanField(default=False, help_text="Can learn from the advice of other executions.")
    policies = models.JSONField(default=list, help_text="Names of the policy types that it can use.")
    listed = models.BooleanField(default=True, help_text="Unticked when a new version of Shepherd no longer has it.")

    class Meta:
        ordering = ["name"]

    def __str__(self) -> str:
        return self.name

    def default_parameters(self) -> dict[str, Any]:
        """The defaults by parameter name, without those that are none."""
        return dict(self.parameters.filter(default__isnull=False).values_list("name", "default"))


class ParameterType(models.IntegerChoices):
    """The type of a parameter's value, numbered as in the thesis."""

    INT = 1, "whole number"
    FLOAT = 2, "number"
    BOOL = 3, "yes or no"
    STR = 4, "text"


class Parameter(models.Model):
    """One parameter of one algorithm."""

    algorithm = models.ForeignKey(Algorithm, models.CASCADE, related_name="parameters")
    name = models.CharField(max_length=100)
    type = models.PositiveSmallIntegerField(choices=ParameterType)
    default = models.JSONField(null=True, blank=True, help_text="Used when an agent sets no value; null: none.")
    help_text = models.TextField(blank=True)
    minimum = models.FloatField(null=True, blank=True)
    maximum = models.FloatField(null=True, blank=True)
    choices = models.JSONField(default=list, blank=True, help_text="The allowed texts; empty: any.")
    position = models.PositiveSmallIntegerField(default=0, help_text="Its place in the algorithm's signature.")
    pattern = models.CharField(max_length=200, blank=True, help_text="A regular expression that a text must match.")

    class Meta:
        ordering = ["algorithm__name", "position"]
        constraints = [models.UniqueConstraint(fields=["algorithm", "name"], name="parameter_once_per_algorithm")]

    def __str__(self) -> str:
        return f"{self.algorithm}: {self.name}"


COLUMNS = {
    ParameterType.INT: "value_int",
    ParameterType.FLOAT: "value_float",
    ParameterType.BOOL: "value_bool",
    ParameterType.STR: "value_str",
}


def _only(column: str) -> Q:
    """The condition that `column` is the only one of the four with a value."""
    return Q(**{f"{name}__isnull": name != column for name in COLUMNS.values()})


class ParameterValue(models.Model):
    """The value of a parameter for one agent; it lives in the column that its type names."""

    agent = models.ForeignKey("agents_app.Agent", models.CASCADE, related_name="parameter_values")
    parameter = models.ForeignKey(Parameter, models.CASCADE, related_name="values")
    type = models.PositiveSmallIntegerField(choices=ParameterType, editable=False)  # of the parameter, for the check
    value_int = models.BigIntegerField(null=True, blank=True)
    value_float = models.FloatField(null=True, blank=True)
    value_bool = models.BooleanField(null=True, blank=True)
    value_str = models.CharField(max_length=500, null=True, blank=True)

    class Meta:
        constraints = [
            models.UniqueConstraint(fields=["agent", "parameter"], name="one_value_per_parameter"),
            models.CheckConstraint(
                name="value_in_the_column_of_its_type",
                condition=Q(*(Q(type=kind) & _only(name) for kind, name in COLUMNS.items()), _connector=Q.OR),
                violation_error_message="Give exactly one value, of the parameter's type.",
            ),
        ]

    def __str__(self) -> str:
        return f"{self.parameter.name} = {self.value}"

    def save(self, *args: Any, **kwargs: Any) -> None:
        """Save, with the parameter's type copied for the database's own check."""
        self.type = self.parameter.type
        super().save(*args, **kwargs)

    def clean(self) -> None:
        """Refuse a value of another algorithm, of the wrong type or out of bounds."""
        self.type = self.parameter.type
        if self.parameter.algorithm_id != self.agent.algorithm_id:
            raise ValidationError({"parameter": f"{self.parameter.name} is no parameter of {self.agent.algorithm}."})
        check_value(self.parameter, self.value)

    @property
    def value(self) -> Any:
        """The value, whichever column it lives in."""
        return getattr(self, COLUMNS[ParameterType(self.type)])

    @value.setter
    def value(self, value: Any) -> None:
        self.type = self.parameter.type
        for kind, column in COLUMNS.items():
            setattr(self, column, value if kind == self.type else None)


def check_value(parameter: Parameter, value: Any) -> None:
    """Raise ValidationError unless `value` is within the parameter's bounds and choices."""
    if value is None:
        raise ValidationError(f"{parameter.name} needs a value: {ParameterType(parameter.type).label}.")
    if isinstance(value, float) and not math.isfinite(value):
        raise ValidationError(f"{parameter.name} is {value}: write a finite number.")
    if parameter.minimum is not None and value < parameter.minimum:
        raise ValidationError(f"{parameter.name} is {value}: write {parameter.minimum:.12g} or more.")
    if parameter.maximum is not None and value > parameter.maximum:
        raise ValidationError(f"{parameter.name} is {value}: write {parameter.maximum:.12g} or less.")
    if parameter.choices and value not in parameter.choices:
        raise ValidationError(f"{parameter.name} is {value!r}: write one of {', '.join(parameter.choices)}.")
    if parameter.pattern and not re.fullmatch(parameter.pattern, value):
        raise ValidationError(f"{parameter.name} is {value!r}, which cannot be read. {parameter.help_text}")
