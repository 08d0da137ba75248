"""How often each action was chosen, and how it was rewarded, by the hour."""

from datetime import UTC, datetime

import pytest
from django.core.exceptions import ValidationError

from agents_app import services, tallies
from agents_app.models import ActionTally
from tests.agents.makers import make_agent

pytestmark = pytest.mark.django_db


def at(hour, month=1):
    """Seconds since the epoch, of that hour of a day in UTC."""
    return datetime(2026, month, 5, hour, 59, tzinfo=UTC).timestamp()


@pytest.fixture
def run():
    return make_agent("counted", counted_in="Europe/Brussels").current_run()


def test_actions_are_counted_by_the_hour_of_the_agents_time_zone(run):
    for hour, month, action, reward in [(12, 1, 3, 1.0), (11, 7, 3, 0.0), (12, 1, 3, -0.5), (23, 1, 0, 1.0)]:
        tallies.count(run.pk, "Europe/Brussels", action, at(hour, month), reward)
    assert tallies.read(run) == {"version": 4, "rows": [(0, 0, 1, 1.0), (3, 13, 3, 0.5)]}
    assert tallies.version(run) == 4


def test_a_run_without_counts_has_none(run):
    assert (tallies.read(run), tallies.version(run)) == ({"version": 0, "rows": []}, 0)


def test_counts_go_with_the_curve_of_their_run_and_no_other(run):
    other = run.agent.runs.create(number=2)
    for each in (run, other):
        tallies.count(each.pk, "UTC", 1, at(3), 1.0)
    services.delete_curve(run)
    assert [tally.run for tally in ActionTally.objects.all()] == [other]


@pytest.mark.parametrize("zone", ["Brussels", "../etc/passwd", "CEST+2"])
def test_what_is_no_time_zone_is_refused(zone):
    with pytest.raises(ValidationError, match="is no time zone: write"):
        make_agent("lost", counted_in=zone)
