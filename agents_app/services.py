"""What one can do with an agent, whoever asks: the admin, a command, the API."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator
from datetime import timedelta
from io import BytesIO
from itertools import chain
from typing import Any

from django.core.exceptions import ValidationError
from django.db import transaction
from django.db.models import QuerySet
from django.utils import timezone

from agents_app.algorithms.registry import get_row
from agents_app.checks_agent import NO_ADVICE, averages_nothing, have_same_spaces, takes_no_advice
from agents_app.checks_parameters import check_parameters
from agents_app.fleet import get_fleet
from agents_app.models import (
    ActionTally,
    Agent,
    APIKey,
    CurveBlock,
    EpisodeReturn,
    Parameter,
    ParameterType,
    ParameterValue,
    Run,
    Session,
    User,
)

LIMITS = {"max_percent_cpu", "max_executions", "sessions_per_execution", "save_interval"}
CSV_HEADER = ("run", "execution", "episode", "return", "length", "learning", "ended_at")


def create_agent(owner: User, fields: dict[str, Any], parameters: dict[str, Any]) -> Agent:
    """A checked agent with its parameter values and its first run. Raises ValidationError."""
    agent = Agent(owner=owner, **fields)
    if fields.get("advice_method", NO_ADVICE) != NO_ADVICE and not agent.algorithm.advice:
        raise ValidationError({"advice_method": takes_no_advice(agent.algorithm)})
    with transaction.atomic():
        agent.full_clean()
        if fields.get("averaging", False) and not get_row(agent.algorithm.name).averages:
            raise ValidationError({"averaging": averages_nothing(agent.algorithm)})
        agent.save()
        set_parameters(agent, parameters)
        agent.current_run()
    return agent


def possible_advisors(agent: Agent) -> QuerySet[Agent]:
    """Agents of the same owner with the same actions and observations, and an algorithm that can advise."""
    able = Agent.objects.filter(owner=agent.owner_id, algorithm__advice=True).exclude(pk=agent.pk)
    return able.filter(pk__in=[other.pk for other in able if have_same_spaces(agent, other)])


def set_parameters(agent: Agent, values: dict[str, Any]) -> None:
    """Give parameters by name their values; None takes the algorithm's default again. Raises ValidationError."""
    known = {parameter.name: parameter for parameter in agent.algorithm.parameters.all()}
    if unknown := sorted(set(values) - set(known)):
        raise ValidationError(f"{agent.algorithm} has no {', '.join(unknown)}: it has {', '.join(sorted(known))}.")
    check_parameters(agent, values)
    with transaction.atomic():
        for name, value in values.items():
            _set_parameter(agent, known[name], value)


def _set_parameter(agent: Agent, parameter: Parameter, value: Any) -> None:
    if value is None:
        ParameterValue.objects.filter(agent=agent, parameter=parameter).delete()
        return
    row = ParameterValue.objects.filter(agent=agent, parameter=parameter).first()
    row = row or ParameterValue(agent=agent, parameter=parameter)
    row.value = value
    row.full_clean()
    row.save()


def parse_value(parameter: Parameter, text: str) -> Any:
    """The value that a text means for a parameter. Raises ValidationError when it means none."""
    try:
        return READERS[ParameterType(parameter.type)](text)
    except (KeyError, ValueError):
        label = ParameterType(parameter.type).label
        raise ValidationError(f"{parameter.name} is {text!r}: write a {label}, e.g. {parameter.default}.") from None


def parse_truth(text: str) -> bool:
    """Yes or no. Raises KeyError when it is neither."""
    words = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}
    return words[text.strip().lower()]


READERS: dict[ParameterType, Callable[[str], Any]] = {
    ParameterType.BOOL: parse_truth,
    ParameterType.INT: int,
    ParameterType.FLOAT: float,
    ParameterType.STR: str,
}


def tell_fleet(agent: Agent, changed: Iterable[str]) -> None:
    """Let the live executions know of changed fields of a saved agent. Raises ConnectionError."""
    if "enable_learning" in changed:
        get_fleet().set_learning(str(agent.pk), agent.enable_learning)
    if LIMITS & set(changed):
        get_fleet().configure(str(agent.pk))


def set_learning(agent: Agent, enabled: bool) -> None:
    """Let the agent learn, or only act as well as it can (evaluate). Raises ConnectionError as tell_fleet does."""
    agent.enable_learning = enabled
    agent.save(update_fields=["enable_learning"])
    tell_fleet(agent, ["enable_learning"])


def restart(agent: Agent) -> int:
    """Save and end all executions; the next steps start new ones. Returns how many. Raises ConnectionError."""
    return get_fleet().restart(str(agent.pk))


def reset_learning(agent: Agent) -> Run:
    """Begin the next run, from nothing; the old one stays readable. Raises ConnectionError after that."""
    with transaction.atomic():
        old = agent.current_run()
        Run.objects.filter(pk=old.pk).update(ended_at=timezone.now())
        run = agent.runs.create(number=old.number + 1)
    restart(agent)
    return run


def delete_saves(run: Run) -> int:
    """Delete all saves of a run. Returns how many. Raises ConnectionError."""
    return get_fleet().delete_saves(run)


@transaction.atomic
def delete_curve(run: Run) -> int:
    """Delete the returns of a run, and what was counted of them. Returns how many."""
    CurveBlock.objects.filter(run=run).delete()
    ActionTally.objects.filter(run=run).delete()
    return EpisodeReturn.objects.filter(run=run).delete()[0]


def delete_agent(agent: Agent) -> None:
    """End its executions, delete its saves, then all that is known of it. Raises ConnectionError before any of that."""
    restart(agent)
    for run in agent.runs.all():
        delete_saves(run)
    agent.delete()


@transaction.atomic
def renew_key(key: APIKey, days: int) -> tuple[APIKey, str]:
    """A key that opens the same, and its secret; the old one goes on for `days`, so that its clients can be changed in peace.

    Raises ValidationError if the old one opens nothing any more, or has a successor already.
    """
    key = APIKey.objects.select_for_update().get(pk=key.pk)
    if not key.is_valid() or key.successor_id:
        raise ValidationError(f"{key} has a successor already, or opens nothing any more: make a new key.")
    successor, secret = APIKey.issue(
        key.agent,
        key.name,
        key.scope,
        publishable=key.publishable,
        origins=key.origins,
        steps_per_minute=key.steps_per_minute,
    )
    end = timezone.now() + timedelta(days=days)
    key.successor, key.expires_at = successor, min(end, key.expires_at or end)
    key.save(update_fields=["successor", "expires_at"])
    return successor, secret


def revoke_key(key: APIKey) -> None:
    """The key opens nothing from now on, and its sessions are closed."""
    now = timezone.now()
    with transaction.atomic():
        APIKey.objects.filter(pk=key.pk, revoked_at=None).update(revoked_at=now)
        Session.objects.filter(api_key=key, closed_at=None).update(closed_at=now)
    get_fleet().note_revoked()


def model_zip(run: Run) -> BytesIO | None:
    """The newest model of a run as a ZIP that stock Stable-Baselines3 loads; None: no save. Raises ConnectionError."""
    return get_fleet().model_zip(run)


def returns_csv(runs: Iterable[Run]) -> Iterator[str]:
    """The returns of runs as lines of CSV, read from the database piece by piece."""
    columns = ("run__number", "execution__number", "episode", "value", "length", "learning", "created_at")
    rows = EpisodeReturn.objects.filter(run__in=list(runs)).order_by("run__number", "id").values_list(*columns)
    writer = csv.writer(_Echo())
    for row in chain([CSV_HEADER], rows.iterator(chunk_size=5000)):
        yield writer.writerow(row)


class _Echo:
    """A file that hands back what is written to it."""

    def write(self, text: str) -> str:
        """The line itself."""
        return text
