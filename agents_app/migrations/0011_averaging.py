"""New agents average what their executions learn (docs/adr/0016); those that are there go on as they did."""

from django.db import migrations, models

FIELD = {
    "verbose_name": "executions average what they learn",
    "help_text": "After each update, an execution goes on from the mean of what all of them have learned. Untick it where "
    "your clients have different problems.",
}


class Migration(migrations.Migration):
    dependencies = [
        ("agents_app", "0010_observations_as_before"),
    ]

    operations = [
        migrations.AddField("agent", "averaging", models.BooleanField(default=False, **FIELD)),
        migrations.AlterField("agent", "averaging", models.BooleanField(default=True, **FIELD)),
    ]
