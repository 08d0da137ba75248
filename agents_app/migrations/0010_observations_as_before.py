"""Agents that were made while `normalize_observations` was off by default keep it off (docs/adr/0013)."""

from django.db import migrations

NOW_ON = ("PPO", "A2C", "TRPO", "PolicyGradient", "MaskablePPO")
BOOL = 3


def keep_off(apps, schema_editor):
    """Say in so many words what was their default: what they have learned depends on it."""
    using = schema_editor.connection.alias
    models = {name: apps.get_model("agents_app", name).objects.using(using) for name in ("Agent", "Parameter", "ParameterValue")}
    for parameter in models["Parameter"].filter(name="normalize_observations", algorithm__name__in=NOW_ON):
        agents = models["Agent"].filter(algorithm=parameter.algorithm_id).exclude(parameter_values__parameter=parameter)
        off = [
            models["ParameterValue"].model(agent=agent, parameter=parameter, type=BOOL, value_bool=False)
            for agent in agents
        ]
        models["ParameterValue"].bulk_create(off)


class Migration(migrations.Migration):
    dependencies = [
        ("agents_app", "0009_action_features"),
    ]

    operations = [
        migrations.RunPython(keep_off, migrations.RunPython.noop),
    ]
