"""Learning curves: the same whether they are summed up or read one by one."""

from datetime import timedelta

import numpy as np
import pytest
from django.utils import timezone

from agents_app import curves, services
from agents_app.models import CurveBlock, EpisodeReturn, Run
from tests.agents.makers import make_agent

pytestmark = pytest.mark.django_db


@pytest.fixture
def run():
    return make_agent("curved").current_run()


def add(run, values, executions=1, age=60):
    known = [run.executions.get_or_create(number=number)[0] for number in range(1, executions + 1)]
    when = timezone.now() - timedelta(seconds=age)
    EpisodeReturn.objects.bulk_create(
        EpisodeReturn(run=run, execution=known[i % executions], episode=i, value=value, length=1, created_at=when)
        for i, value in enumerate(values)
    )


def test_a_run_without_returns_has_an_empty_line(run):
    assert curves.read(run) == {
        "version": 0,
        "behind": False,
        "lines": [{"name": "all", "x": [], "value": [], "mean": [], "deviation": []}],
    }


def test_a_short_curve_has_every_return_and_the_moving_average(run):
    values = np.arange(300.0)
    add(run, values)
    [line] = curves.read(run)["lines"]
    assert line["value"] == values.tolist()
    assert line["x"] == list(range(1, 301))
    assert line["mean"][9] == pytest.approx(values[:10].mean())
    assert line["mean"][299] == pytest.approx(values[200:].mean())
    assert line["deviation"][299] == pytest.approx(values[200:].std(), rel=1e-4)
    assert not CurveBlock.objects.exists()


def test_executions_have_a_line_each(run):
    add(run, [1.0, 10.0, 2.0, 20.0, 3.0], executions=2)
    lines = {line["name"]: line["value"] for line in curves.read(run, by_execution=True)["lines"]}
    assert lines == {"execution 1": [1.0, 2.0, 3.0], "execution 2": [10.0, 20.0]}


@pytest.mark.parametrize("by_execution", [False, True])
def test_a_long_curve_is_short_and_true(run, by_execution):
    values = np.random.default_rng(0).normal(50, 5, 9_000) + np.arange(9_000) / 100
    for part in np.split(values, [2_500, 2_501, 7_003]):  # in pieces that do not end with a block
        add(run, part, executions=2 if by_execution else 1)
        curves.read(run, by_execution)
    lines = curves.read(run, by_execution)["lines"]
    assert sum(len(line["x"]) for line in lines) < 2 * curves.RAW
    if not by_execution:
        assert lines[0]["x"][-1] == 9_000
        assert lines[0]["mean"][-1] == pytest.approx(values[-100:].mean(), rel=0.01)
        assert lines[0]["deviation"][-1] == pytest.approx(values[-100:].std(), rel=0.2)
    kept = CurveBlock.objects.filter(run=run, execution__isnull=not by_execution)
    in_blocks = EpisodeReturn.objects.filter(run=run, id__lte=Run.objects.get(pk=run.pk).summed_to)
    assert sum(kept.values_list("count", flat=True)) == in_blocks.count() > 6_000
    assert sum(kept.values_list("total", flat=True)) == pytest.approx(sum(in_blocks.values_list("value", flat=True)))
    full = [block.count for block in kept.order_by("execution", "number")]
    assert full.count(curves.BLOCK) >= len(full) - 2


def test_returns_that_may_still_be_overtaken_are_not_summed_up(run):
    add(run, np.zeros(2_500), age=0)
    curves.read(run)
    assert not CurveBlock.objects.exists()


@pytest.mark.parametrize(
    "age", [9, -100, -3600], ids=["a moment ago", "another clock, ahead", "the clock was set back"]
)
def test_no_return_is_left_behind_by_later_ones_that_seem_older(run, age):
    add(run, np.zeros(2_100))
    add(run, np.full(500, 7.0), age=age)
    add(run, np.zeros(2_100))
    curves.sum_up(run)
    line = curves.read(run)["lines"][0]
    assert line["x"][-1] == 4_700
    in_blocks = sum(CurveBlock.objects.filter(execution=None).values_list("count", flat=True))
    assert in_blocks + EpisodeReturn.objects.filter(id__gt=run.summed_to).count() == 4_700


def test_a_return_of_the_far_future_holds_nothing_up(run):
    add(run, np.zeros(5), age=-3600 * 24 * 365)
    add(run, np.zeros(2_100))
    curves.sum_up(run)
    assert sum(CurveBlock.objects.filter(execution=None).values_list("count", flat=True)) == 2_105


def test_of_two_readers_at_once_one_sums_up(run):
    add(run, np.ones(3_000))
    stale = Run.objects.get(pk=run.pk)
    curves.sum_up(run)
    rows = np.array([(3_000, 1, 1.0)], dtype=[("id", "i8"), ("execution", "i8"), ("value", "f8")])
    curves._add_blocks(stale, rows)
    assert sum(CurveBlock.objects.filter(execution=None).values_list("count", flat=True)) == 3_000


def test_catching_up_takes_as_many_turns_as_it_needs(run, monkeypatch):
    monkeypatch.setattr(curves, "AT_ONCE", 2_000)
    add(run, np.ones(6_100))
    assert curves.read(run)["behind"]
    assert curves.catch_up(seconds=0)
    assert not curves.catch_up(seconds=600)
    curve = curves.read(run)
    assert not curve["behind"]
    assert curve["lines"][0]["x"][-1] == 6_100


def test_a_deleted_curve_stays_deleted_and_starts_anew(run):
    add(run, np.ones(3_000))
    curves.read(run)
    assert services.delete_curve(run) == 3_000
    assert curves.read(run)["lines"][0]["x"] == []
    add(run, np.full(2_100, 5.0))
    line = curves.read(run)["lines"][0]
    assert (line["x"][-1], line["mean"][-1]) == (2_100, 5.0)


def test_a_reader_whom_another_one_overtakes_counts_nothing_twice(run, monkeypatch):
    add(run, np.ones(1_900))
    blocks = curves._blocks

    def overtaken(*arguments):
        found = blocks(*arguments)
        monkeypatch.setattr(curves, "_blocks", blocks)
        add(run, np.ones(200))
        curves.sum_up(Run.objects.get(pk=run.pk))
        return found

    monkeypatch.setattr(curves, "_blocks", overtaken)
    assert curves.read(run)["lines"][0]["x"][-1] == 2_100
