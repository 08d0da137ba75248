"""Observations are normalised by default where ADR 0013 says so, and for no agent that was made before."""

from importlib import import_module
from types import SimpleNamespace

import pytest
from django.apps import apps
from django.db import connection
from django.db.migrations import RunPython

from agents_app import services
from agents_app.algorithms.registry import ROWS
from agents_app.catalogue import NORMALISING
from agents_app.models import Parameter, ParameterValue
from tests.agents.makers import make_agent

pytestmark = pytest.mark.django_db
NAME = "normalize_observations"
MIGRATIONS = [
    import_module(f"agents_app.migrations.{name}")
    for name in ("0010_observations_as_before", "0012_texts_and_observations", "0013_texts_and_qr_dqn")
]


def migrate() -> None:
    """What they run of Python, which needs no more of a schema editor."""
    for migration in MIGRATIONS:
        for operation in migration.Migration.operations:
            if isinstance(operation, RunPython):
                operation.code(apps, SimpleNamespace(connection=connection))


def test_only_algorithms_that_can_normalise_do_so_by_default() -> None:
    assert {row.name for row in ROWS if row.normalises} >= NORMALISING
    defaults = dict(Parameter.objects.filter(name=NAME).values_list("algorithm__name", "default"))
    assert {name for name, default in defaults.items() if default} == NORMALISING
    assert {name for migration in MIGRATIONS[:2] for name in migration.NOW_ON} == NORMALISING


def test_a_new_agent_normalises_unless_its_owner_says_no() -> None:
    assert make_agent("new").parameters()[NAME] is True
    assert make_agent("no", parameters={NAME: False}).parameters()[NAME] is False
    assert make_agent("off the policy", algorithm="DQN").parameters()[NAME] is False


def test_an_agent_made_before_goes_on_as_it_was() -> None:
    old, sac = make_agent("old"), make_agent("sac", algorithm="SAC", action_space=[[2], -1, 1])
    chosen, other = make_agent("chosen", parameters={NAME: True}), make_agent("q", algorithm="DQN")
    migrate()
    assert old.own_parameters() == sac.own_parameters() == {NAME: False}
    assert chosen.own_parameters() == {NAME: True}
    assert other.own_parameters() == {}
    ParameterValue.objects.get(agent=old).full_clean()
    migrate()  # again changes nothing
    assert ParameterValue.objects.filter(agent=old).count() == 1


def test_an_agent_made_before_can_take_the_new_default_once_it_is_reset() -> None:
    old = make_agent("old")
    migrate()
    services.set_parameters(old, {NAME: None})
    assert old.parameters()[NAME] is True


def test_so_does_one_that_explored_for_a_short_while() -> None:
    old, other = make_agent("old", algorithm="QR-DQN"), make_agent("other", algorithm="DQN")
    assert old.parameters()["exploration_fraction"] == other.parameters()["exploration_fraction"] == 0.1
    migrate()
    assert old.parameters()["exploration_fraction"] == 0.005
    assert other.parameters()["exploration_fraction"] == 0.1
