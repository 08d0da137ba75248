"""Agents: what an owner configures and clients train."""

from __future__ import annotations

import uuid
import zoneinfo
from typing import Any

from django.conf import settings
from django.core.exceptions import ValidationError
from django.core.validators import MaxValueValidator, MinValueValidator
from django.db import models
from django.utils import timezone

from agents_app.algorithms import mixing
from agents_app.algorithms.registry import get_row
from agents_app.models.catalogue import Algorithm


def check_zone(name: str) -> None:
    """Refuse what is no time zone."""
    if name not in zoneinfo.available_timezones():
        raise ValidationError(f"{name!r} is no time zone: write e.g. Europe/Brussels, or UTC.")


class Agent(models.Model):
    """A configuration: algorithm, spaces, parameter values, advice settings; its runs hold what was learned."""

    class AdviceMethod(models.TextChoices):
        NONE = "none", "No advice"
        INTERSECTION = mixing.INTERSECTION, "Policy intersection: what both agree on"
        GEOMETRIC = mixing.GEOMETRIC, "Geometric mean: between both, no surer than they are"
        UNION = mixing.UNION, "Policy union: what either of them would do (one of n actions only)"
        REUSE = mixing.REUSE, "Policy reuse: what the advisor would do, now and then"
        SHAPING = mixing.SHAPING, "Reward shaping: a reward for what the advisor would do"

    class Advisors(models.TextChoices):
        RANDOM = mixing.RANDOM, "One live execution, drawn at random at each step"
        BEST = mixing.BEST, "The live execution with the best recent returns"
        SEVERAL = mixing.SEVERAL, "Three live executions together, drawn at random at each step"
        ALL = mixing.ALL, "All live executions together"

    class ContinuousAdvice(models.TextChoices):
        MEAN = mixing.BY_MEAN, "Half way between the agent's action and the advisor's"
        SAMPLING = mixing.BY_SAMPLING, "Of many actions of the advisor, one that the agent finds probable"

    class AdviceForm(models.TextChoices):
        SOFT = mixing.SOFT, "An opinion: how good each action is"
        DETERMINISTIC = mixing.DETERMINISTIC, "An order: the one action that the advisor finds best"

    class LastWord(models.TextChoices):
        LEARNER = mixing.LEARNER, "The agent"
        ADVISOR = mixing.ADVISOR, "The advisor"

    class StartFrom(models.TextChoices):
        LATEST = "latest", "The latest save"
        BEST = "best", "The save with the best recent mean return"

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    owner = models.ForeignKey(settings.AUTH_USER_MODEL, models.CASCADE, related_name="agents")
    name = models.CharField(max_length=150)
    algorithm = models.ForeignKey(
        Algorithm, models.PROTECT, related_name="agents", help_text="Cannot be changed once the agent exists."
    )
    policy = models.CharField(
        "policy type",
        max_length=50,
        default="auto",
        help_text="The kind of network. 'auto' takes a Cnn policy for images, a MultiInput policy for "
        "dictionaries, and the algorithm's first one for everything else.",
    )
    action_space = models.JSONField(
        help_text="A whole number n: one of n actions. [[shape], low, high]: a vector of numbers, e.g. [[2], -1, 1]. "
        "Bounds of about -1 and 1 are best: your client scales what it gets."
    )
    observation_space = models.JSONField(
        help_text="A whole number n: one of n states. [[shape], low, high]: numbers, e.g. [[8], -10, 10]; "
        "[[height, width, channels], 0, 255]: an image; "
        "for other numbers up to 255 write 0.0 and 255.0. A dictionary of those: several sensors."
    )
    enable_learning = models.BooleanField(
        default=True, help_text="Unticked, the agent acts as well as it can and learns nothing."
    )
    action_masks = models.BooleanField(
        "some actions are forbidden at times",
        default=False,
        help_text="The client says at each step which of the n actions are allowed (action_mask); no other one is chosen.",
    )
    action_features = models.JSONField(
        null=True,
        blank=True,
        help_text="What you know of the n actions: n rows of as many numbers, e.g. [[1, 0], [0.5, 1]], each from -1 to 1 or so. "
        "What is learned of one action then holds for those like it. Empty: each action is learned on its own.",
    )
    max_percent_cpu = models.PositiveIntegerField(
        "maximum percent of CPU",
        default=200,
        validators=[MinValueValidator(1), MaxValueValidator(100_000)],
        help_text="100 is one CPU, over a minute, for all executions together. Past it, clients are told to wait.",
    )
    max_executions = models.PositiveIntegerField(
        default=32, validators=[MinValueValidator(1)], help_text="How many executions may run at once."
    )
    sessions_per_execution = models.PositiveIntegerField(
        default=1,
        validators=[MinValueValidator(1)],
        help_text="1: each client trains its own execution. More: slow clients (people) share a few executions.",
    )
    answer_within = models.PositiveIntegerField(
        "seconds to answer an action",
        default=0,
        help_text="A client that is silent for so long has its episode ended by the agent. 0: it may take its time.",
    )
    unanswered_reward = models.FloatField(
        "reward of an action that is not answered",
        default=0.0,
        validators=[MinValueValidator(-1e9), MaxValueValidator(1e9)],
        help_text="What the agent learns from then, as the end of the episode. The learning curve does not count it.",
    )
    advice_method = models.CharField(
        max_length=20,
        choices=AdviceMethod,
        default=AdviceMethod.INTERSECTION,
        help_text="How the executions of this agent, or you at the client, help each of them to choose its actions. "
        "Intersection is the one to try first.",
    )
    advisors = models.CharField(
        "who advises",
        max_length=20,
        choices=Advisors,
        default=Advisors.RANDOM,
        help_text="Where several cannot be mixed into one, one of them is drawn at random at each step.",
    )
    peers_advise = models.BooleanField(
        "executions advise each other",
        default=True,
        help_text="Unticked, only the agent chosen below advises, or you at the client.",
    )
    advisor = models.ForeignKey(
        "self",
        models.SET_NULL,
        null=True,
        blank=True,
        related_name="advised",
        verbose_name="an agent that advises",
        help_text="Another agent of yours with the same actions and observations, which has learned already. It advises as it "
        "acted when it was saved, and learns nothing from this.",
    )
    advisor_save = models.CharField(
        "with which save",
        max_length=10,
        choices=StartFrom,
        default=StartFrom.LATEST,
        help_text="Chosen anew whenever an execution starts.",
    )
    advice_form = models.CharField(
        "advice is",
        max_length=20,
        choices=AdviceForm,
        default=AdviceForm.SOFT,
        help_text="The agent can learn to do without an opinion. An order is obeyed: for rules that must be kept.",
    )
    rho = models.FloatField(
        "influence (rho)",
        default=1.0,
        validators=[MinValueValidator(0), MaxValueValidator(1)],
        help_text="1 is the advice as it is. Less makes it less certain; 0.7 suits advisors that know another task.",
    )
    continuous_advice = models.CharField(
        "the action is",
        max_length=20,
        choices=ContinuousAdvice,
        default=ContinuousAdvice.MEAN,
        help_text="Half way is quick and smooth. With samples, an agent that is sure of itself stops listening.",
    )
    advice_samples = models.PositiveIntegerField(
        "samples",
        default=64,
        validators=[MinValueValidator(1), MaxValueValidator(4096)],
        help_text="How many actions of the advisor are compared at each step. More are slower, and nearer to agreement.",
    )
    last_word = models.CharField(
        "who has the last word",
        max_length=20,
        choices=LastWord,
        default=LastWord.LEARNER,
        help_text="Where the agent and the advisor agree on no action at all. Half way between two, there is always one.",
    )
    advice_weight = models.FloatField(
        "weight of the advice",
        default=1.0,
        validators=[MinValueValidator(0), MaxValueValidator(100)],
        help_text="How much each advisor counts beside the agent itself: 1 is as much, 0 is nothing, 3 is three times as much. "
        "Where actions are vectors of numbers, all advisors together count so.",
    )
    psi = models.FloatField(
        "how often (psi)",
        default=0.5,
        validators=[MinValueValidator(0), MaxValueValidator(1)],
        help_text="Which share of the actions is the advisor's: 0 is none, 1 is all, and then nothing is learned but to imitate.",
    )
    shaping_scale = models.FloatField(
        "scale of the reward",
        default=1.0,
        validators=[MinValueValidator(0), MaxValueValidator(1_000_000)],
        help_text="What an action is rewarded of which the advisor is certain; of vectors of numbers many times that, "
        "if it is very certain. The learning curve does not count it.",
    )
    learning_correction = models.BooleanField(
        default=True,
        help_text="Let the learning rule know that actions were chosen with advice. Without it, many agents unlearn what "
        "they were advised; a few learn faster.",
    )
    averaging = models.BooleanField(
        "executions average what they learn",
        default=True,
        help_text="After each update, an execution goes on from the mean of what all of them have learned. Untick it where "
        "your clients have different problems.",
    )
    start_from = models.CharField(
        max_length=10,
        choices=StartFrom,
        default=StartFrom.LATEST,
        help_text="With what a new execution begins, when there are saves: with what was learned last, or with what was learned "
        "when the returns were highest.",
    )
    save_interval = models.PositiveIntegerField(
        default=10_000, validators=[MinValueValidator(1)], help_text="Steps between two saves of an execution."
    )
    public = models.BooleanField(
        "public live page",
        default=False,
        help_text="Anybody may see the learning curve, the executions and who advises whom, at /agents/.../. Nobody sees keys, "
        "errors or your other agents there.",
    )
    counted_in = models.CharField(
        "count actions by the hour in",
        max_length=64,
        blank=True,
        default="",
        validators=[check_zone],
        help_text="A time zone, e.g. Europe/Brussels. Of episodes of one step, the live page then says how often each action was "
        "chosen, and how it was rewarded, by the hour there. Empty: nothing is counted.",
    )
    created_at = models.DateTimeField("created", default=timezone.now, editable=False)
    last_activity_at = models.DateTimeField("last activity", null=True, editable=False)

    class Meta:
        ordering = ["owner__name", "name"]
        constraints = [models.UniqueConstraint(fields=["owner", "name"], name="agent_name_once_per_owner")]

    def __str__(self) -> str:
        return self.name

    def parameters(self) -> dict[str, Any]:
        """The algorithm's parameters by name: the owner's values, else the defaults; what has neither is left out."""
        return self.algorithm.default_parameters() | self.own_parameters()

    def own_parameters(self) -> dict[str, Any]:
        """The values that the owner set, by parameter name."""
        return {value.parameter.name: value.value for value in self.parameter_values.select_related("parameter")}

    @property
    def takes_masks(self) -> bool:
        """Whether clients may say which actions are allowed; with MaskablePPO they always may."""
        return self.action_masks or get_row(self.algorithm.name).family == "maskable"

    def has_learned(self) -> bool:
        """Whether the current run has anything that depends on the spaces and the policy."""
        run = self.runs.order_by("-number").first()
        return run is not None and run.executions.exists()

    def current_run(self) -> Any:
        """The run that learns now; the first one is made here."""
        run = self.runs.order_by("-number").first()
        return run or self.runs.get_or_create(number=1)[0]

    def clean(self) -> None:
        """Refuse spaces that are none, and an algorithm or policy that does not fit them."""
        from agents_app.checks_agent import check_agent, check_fixed

        if before := Agent.objects.filter(pk=self.pk).first():
            if before.algorithm_id != self.algorithm_id:
                raise ValidationError({"algorithm": "The algorithm of an agent is fixed: make a new agent instead."})
            check_fixed(before, self)
        check_agent(self)
