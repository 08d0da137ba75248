"""Agents that were made while `normalize_observations` was off by default keep it off (docs/adr/0013)."""

from django.db import migrations

from agents_app.migrations._as_before import keep_off

NOW_ON = ("PPO", "A2C", "TRPO", "PolicyGradient", "MaskablePPO")


class Migration(migrations.Migration):
    dependencies = [
        ("agents_app", "0009_action_features"),
    ]

    operations = [
        migrations.RunPython(keep_off(NOW_ON), migrations.RunPython.noop),
    ]
