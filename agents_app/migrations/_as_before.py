"""What migrations do when a default changes on which depends what agents have learned."""

from __future__ import annotations

from typing import Any

FLOAT, BOOL = 2, 3


def keep_off(algorithms: tuple[str, ...]) -> Any:
    """For RunPython: agents of these algorithms that left `normalize_observations` at its default, no, say no in so many words."""
    return keep("normalize_observations", algorithms, type=BOOL, value_bool=False)


def keep(name: str, algorithms: tuple[str, ...], **value: Any) -> Any:
    """For RunPython: agents of these algorithms that left this parameter at its default of before have it in so many words."""

    def change(apps: Any, schema_editor: Any) -> None:
        using = schema_editor.connection.alias
        models = {
            name: apps.get_model("agents_app", name).objects.using(using)
            for name in ("Agent", "Parameter", "ParameterValue")
        }
        for parameter in models["Parameter"].filter(name=name, algorithm__name__in=algorithms):
            agents = models["Agent"].filter(algorithm=parameter.algorithm_id)
            kept = [
                models["ParameterValue"].model(agent=agent, parameter=parameter, **value)
                for agent in agents.exclude(parameter_values__parameter=parameter)
            ]
            models["ParameterValue"].bulk_create(kept)

    return change
