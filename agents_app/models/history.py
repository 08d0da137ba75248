"""What an agent has lived through: runs, executions, saves, returns, errors."""

from __future__ import annotations

import uuid

from django.db import models
from django.utils import timezone


class Run(models.Model):
    """One learning history of an agent. Resetting the learning begins the next one and keeps this one readable."""

    agent = models.ForeignKey("agents_app.Agent", models.CASCADE, related_name="runs")
    number = models.PositiveIntegerField()
    started_at = models.DateTimeField(default=timezone.now)
    ended_at = models.DateTimeField(null=True, blank=True)
    summed_to = models.BigIntegerField(default=0, editable=False)  # the last EpisodeReturn that is in a CurveBlock

    class Meta:
        ordering = ["number"]
        constraints = [models.UniqueConstraint(fields=["agent", "number"], name="run_number_once_per_agent")]

    def __str__(self) -> str:
        return f"{self.agent}, run {self.number}"


class Execution(models.Model):
    """One worker process that ran the agent's algorithm. What it does now is asked of the fleet, not kept here."""

    run = models.ForeignKey(Run, models.CASCADE, related_name="executions")
    uid = models.UUIDField(unique=True, default=uuid.uuid4, editable=False)
    number = models.PositiveIntegerField(help_text="Counts the executions of a run from 1.")
    started_at = models.DateTimeField(default=timezone.now)
    ended_at = models.DateTimeField(null=True, blank=True)
    end_reason = models.CharField(max_length=50, blank=True)  # idle, restart, crash, stop, lost, parent gone

    class Meta:
        ordering = ["number"]
        constraints = [models.UniqueConstraint(fields=["run", "number"], name="execution_number_once_per_run")]

    def __str__(self) -> str:
        return f"execution {self.number}"


class ExecutionError(models.Model):
    """A failure inside an execution, with its traceback; shown in the admin, never sent to a client."""

    run = models.ForeignKey(Run, models.CASCADE, related_name="errors")
    execution_uid = models.UUIDField()
    created_at = models.DateTimeField(default=timezone.now)
    summary = models.CharField(max_length=500)
    traceback = models.TextField()

    class Meta:
        ordering = ["-created_at"]

    def __str__(self) -> str:
        return self.summary


class Save(models.Model):
    """A checkpoint of an execution. The folder is the truth (envs_app.execution.saves); this is its catalogue."""

    run = models.ForeignKey(Run, models.CASCADE, related_name="saves")
    execution_uid = models.UUIDField()
    name = models.CharField(max_length=200, help_text="The name of its folder within the run's.")
    steps = models.BigIntegerField(help_text="Environment steps learned from, since the run began.")
    mean_return = models.FloatField(null=True, help_text="Over the last 100 episodes.")
    size = models.BigIntegerField(help_text="Bytes.")
    created_at = models.DateTimeField(default=timezone.now)

    class Meta:
        ordering = ["-created_at"]
        constraints = [models.UniqueConstraint(fields=["run", "name"], name="save_once_per_run")]

    def __str__(self) -> str:
        return self.name


class EpisodeReturn(models.Model):
    """The sum of the rewards of one episode. Durable before the client hears of the episode's end."""

    run = models.ForeignKey(Run, models.CASCADE, related_name="returns")
    execution = models.ForeignKey(Execution, models.CASCADE, related_name="returns")
    session = models.ForeignKey("agents_app.Session", models.SET_NULL, null=True, related_name="returns")
    episode = models.PositiveIntegerField(help_text="Counts the episodes of the session from 1.")
    value = models.FloatField(help_text="Sum of the rewards.")
    length = models.PositiveIntegerField(help_text="Steps.")
    learning = models.BooleanField(default=True, help_text="False: the agent was being evaluated.")
    created_at = models.DateTimeField(default=timezone.now)

    class Meta:
        ordering = ["id"]
        constraints = [models.UniqueConstraint(fields=["session", "episode"], name="episode_once_per_session")]
        indexes = [models.Index(fields=["run", "id", "execution", "value"], name="curve_of_a_run")]

    def __str__(self) -> str:
        return f"{self.value:g}"


class CurveBlock(models.Model):
    """The sums of some returns in a row, of a run or of one execution, so that long curves are read quickly."""

    run = models.ForeignKey(Run, models.CASCADE, related_name="blocks")
    execution = models.ForeignKey(Execution, models.CASCADE, null=True, related_name="blocks")  # null: all together
    number = models.PositiveIntegerField()  # counts from 0
    count = models.PositiveIntegerField()
    total = models.FloatField()
    squares = models.FloatField()
    sample = models.FloatField()  # the first of them

    class Meta:
        ordering = ["number"]
        indexes = [models.Index(fields=["run", "execution", "number"], name="blocks_of_a_curve")]

    def __str__(self) -> str:
        return f"block {self.number}"


class ActionTally(models.Model):
    """How often an action was chosen in an hour of the day, and what that was rewarded; of episodes of one step."""

    run = models.ForeignKey(Run, models.CASCADE, related_name="tallies")
    action = models.PositiveIntegerField()
    hour = models.PositiveSmallIntegerField(help_text="0 to 23, in the time zone in which the agent is counted.")
    count = models.PositiveBigIntegerField(default=0)
    total = models.FloatField(default=0.0, help_text="Sum of the rewards.")

    class Meta:
        ordering = ["action", "hour"]
        constraints = [models.UniqueConstraint(fields=["run", "action", "hour"], name="tally_once_per_hour")]

    def __str__(self) -> str:
        return f"action {self.action} at {self.hour}: {self.count} times"
