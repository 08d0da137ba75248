"""Help texts, bounds; and agents of QR-DQN that were made while it explored for 500 steps by default keep it so."""

import django.core.validators
from django.db import migrations, models

from agents_app.migrations._as_before import FLOAT, keep


class Migration(migrations.Migration):

    dependencies = [
        ('agents_app', '0012_texts_and_observations'),
    ]

    operations = [
        migrations.RunPython(
            keep("exploration_fraction", ("QR-DQN",), type=FLOAT, value_float=0.005), migrations.RunPython.noop
        ),
        migrations.AlterField(
            model_name='agent',
            name='action_space',
            field=models.JSONField(help_text='A whole number n: one of n actions. [[shape], low, high]: a vector of numbers, e.g. [[2], -1, 1]. Bounds of about -1 and 1 are best: your client scales what it gets.'),
        ),
        migrations.AlterField(
            model_name='agent',
            name='observation_space',
            field=models.JSONField(help_text='A whole number n: one of n states. [[shape], low, high]: numbers, e.g. [[8], -10, 10]; [[height, width, channels], 0, 255]: an image; for other numbers up to 255 write 0.0 and 255.0. A dictionary of those: several sensors.'),
        ),
        migrations.AlterField(
            model_name='agent',
            name='psi',
            field=models.FloatField(default=0.5, help_text="Which share of the actions is the advisor's: 0 is none, 1 is all, and then nothing is learned but to imitate.", validators=[django.core.validators.MinValueValidator(0), django.core.validators.MaxValueValidator(1)], verbose_name='how often (psi)'),
        ),
        migrations.AlterField(
            model_name='agent',
            name='shaping_scale',
            field=models.FloatField(default=1.0, help_text='What an action is rewarded of which the advisor is certain; of vectors of numbers many times that, if it is very certain. The learning curve does not count it.', validators=[django.core.validators.MinValueValidator(0), django.core.validators.MaxValueValidator(1000000)], verbose_name='scale of the reward'),
        ),
        migrations.AlterField(
            model_name='agent',
            name='unanswered_reward',
            field=models.FloatField(default=0.0, help_text='What the agent learns from then, as the end of the episode. The learning curve does not count it.', validators=[django.core.validators.MinValueValidator(-1000000000.0), django.core.validators.MaxValueValidator(1000000000.0)], verbose_name='reward of an action that is not answered'),
        ),
    ]
