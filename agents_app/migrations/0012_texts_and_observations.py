"""Help texts; and agents that were made while these left observations as they were keep it so (docs/adr/0013)."""

import django.core.validators
from django.db import migrations, models

from agents_app.migrations._as_before import keep_off

NOW_ON = ("SAC", "TQC", "TD3", "DDPG")


class Migration(migrations.Migration):

    dependencies = [
        ('agents_app', '0011_averaging'),
    ]

    operations = [
        migrations.RunPython(keep_off(NOW_ON), migrations.RunPython.noop),
        migrations.AlterField(
            model_name='agent',
            name='advice_weight',
            field=models.FloatField(default=1.0, help_text='How much each advisor counts beside the agent itself: 1 is as much, 0 is nothing, 3 is three times as much. Where actions are vectors of numbers, all advisors together count so.', validators=[django.core.validators.MinValueValidator(0), django.core.validators.MaxValueValidator(100)], verbose_name='weight of the advice'),
        ),
        migrations.AlterField(
            model_name='agent',
            name='start_from',
            field=models.CharField(choices=[('latest', 'The latest save'), ('best', 'The save with the best recent mean return')], default='latest', help_text='With what a new execution begins, when there are saves: with what was learned last, or with what was learned when the returns were highest.', max_length=10),
        ),
    ]
