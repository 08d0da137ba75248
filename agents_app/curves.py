"""Learning curves of any length, read quickly: sums of twenty returns in a row are kept, and completed on reading.

A curve has a point per return as long as there are few, and per so many returns when there are many. At each point
stand one return as a sample, and the mean and the standard deviation of the last hundred returns (or of the point's
own, if more).
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from datetime import timedelta
from itertools import takewhile
from typing import Any

import numpy as np
from django.db import transaction
from django.db.models import F, Min, Q, Sum
from django.db.models.functions import Mod
from django.utils import timezone

from agents_app.models import CurveBlock, EpisodeReturn, Run

BLOCK = 20  # returns in a block
POINTS = 1000  # of blocks, over all lines of a curve
WINDOW = 100  # episodes of the moving average (thesis, figure 5.17)
RAW = 2000  # so many returns are read one by one before they are summed up
AT_ONCE = 20_000  # returns that one reading sums up; the next one goes on
SETTLED = timedelta(seconds=10)  # after that, no transaction still holds back a return with a lower id
AHEAD = timedelta(minutes=10)  # so far the clock of another machine may be; what is later still has nothing to wait for


@dataclass
class Line:
    """Some returns in a row, in pieces: arrays of one length."""

    count: np.ndarray
    total: np.ndarray
    squares: np.ndarray
    sample: np.ndarray

    @classmethod
    def of_returns(cls, values: np.ndarray) -> Line:
        """A piece per return."""
        return cls(np.ones(len(values)), values, values**2, values)

    def merge(self, size: int) -> Line:
        """The same with so many pieces made one; the last one may be smaller."""
        starts = np.arange(0, len(self.count), size)
        if size == 1 or not len(starts):
            return self
        count, total, squares = (np.add.reduceat(array, starts) for array in (self.count, self.total, self.squares))
        return Line(count, total, squares, self.sample[starts])

    def __add__(self, other: Line) -> Line:
        return Line(*(np.concatenate(pair) for pair in zip(vars(self).values(), vars(other).values(), strict=True)))


def read(run: Run, by_execution: bool = False) -> dict[str, Any]:
    """The curve for the page: lines of points, and whether there is more to sum up than one reading does."""
    newest, behind = version(run), sum_up(run)
    lines = _lines(run, behind, by_execution)
    names: dict[int | None, str] = {
        key: f"execution {number}" for key, number in run.executions.values_list("pk", "number")
    }
    return {
        "version": newest,
        "behind": behind,
        "lines": [{"name": names.get(key, "all"), **_points(line)} for key, line in lines.items()],
    }


def version(run: Run) -> int:
    """Grows with each new return; a reader who has this one has all."""
    return EpisodeReturn.objects.filter(run=run).order_by("-id").values_list("id", flat=True).first() or 0


def catch_up(seconds: float = 1.0) -> bool:
    """Sum up the runs that go on, so that nobody who opens a curve waits; for a housekeeper. True: there is more."""
    until = time.monotonic() + seconds
    for run in Run.objects.filter(ended_at=None):
        while sum_up(run):
            if time.monotonic() > until:
                return True
    return False


def sum_up(run: Run) -> bool:
    """Put settled returns into blocks, if they are many. Returns whether there are more."""
    run.refresh_from_db(fields=["summed_to"])
    found = _settled(run)
    if len(found) >= RAW:
        _add_blocks(run, np.array(found, dtype=[("id", "i8"), ("execution", "i8"), ("value", "f8")]))
    return len(found) == AT_ONCE


def _settled(run: Run) -> list[tuple[int, int, float]]:
    """Id, execution and value of the next returns, up to the first that is too new, though later ones may seem older: times come
    from many clocks, and what lies before `summed_to` is never looked at again."""
    now = timezone.now()
    new = Q(created_at__gt=now - SETTLED, created_at__lt=now + AHEAD)
    rows = EpisodeReturn.objects.filter(run=run, id__gt=run.summed_to).order_by("id").annotate(new=new)
    found = rows.values_list("id", "execution_id", "value", "new")[:AT_ONCE]
    return [row[:3] for row in takewhile(lambda row: not row[3], found)]


@transaction.atomic
def _add_blocks(run: Run, rows: np.ndarray) -> None:
    """Compare and set: of two readers at once, one sums up."""
    last = int(rows["id"][-1])
    if Run.objects.filter(pk=run.pk, summed_to=run.summed_to).update(summed_to=last):
        _append(run, None, rows["value"])
        for execution in np.unique(rows["execution"]):
            _append(run, int(execution), rows["value"][rows["execution"] == execution])
    run.refresh_from_db(fields=["summed_to"])


def _append(run: Run, execution: int | None, values: np.ndarray) -> None:
    """Fill up the last block of a line, then make new ones."""
    last = CurveBlock.objects.filter(run=run, execution=execution).order_by("-number").first()
    room = BLOCK - last.count if last else 0
    if last and room:
        head = values[:room]
        last.count, last.total = last.count + len(head), last.total + float(head.sum())
        last.squares += float((head**2).sum())
        last.save()
    first = last.number + 1 if last else 0
    blocks = Line.of_returns(values[room:]).merge(BLOCK)
    CurveBlock.objects.bulk_create(
        [
            CurveBlock(
                run=run, execution_id=execution, number=number, count=count, total=total, squares=squares, sample=sample
            )
            for number, (count, total, squares, sample) in enumerate(zip(*vars(blocks).values(), strict=True), first)
        ],
        batch_size=1000,
    )


def _tail(run: Run, behind: bool) -> np.ndarray:
    """The executions and values of the returns that are in no block yet; none while there are too many."""
    rows = EpisodeReturn.objects.filter(run=run, id__gt=run.summed_to).order_by("id")
    rows = rows.none() if behind else rows
    return np.array(list(rows.values_list("execution_id", "value")), dtype=[("execution", "i8"), ("value", "f8")])


def _lines(run: Run, behind: bool, by_execution: bool) -> dict[int | None, Line]:
    """Blocks, then the returns after them, by execution or (None) all together."""
    lines, tail = _blocks_and_tail(run, behind, by_execution)
    for key in np.unique(tail["execution"]).tolist() if by_execution else [None]:
        values = tail["value"] if key is None else tail["value"][tail["execution"] == key]
        line = Line.of_returns(values)
        lines[key] = lines[key] + line if key in lines else line
    most = max(RAW // max(len(lines), 1), 50)
    return {key: line.merge(-(-len(line.count) // most) or 1) for key, line in lines.items()}


def _blocks_and_tail(run: Run, behind: bool, by_execution: bool) -> tuple[dict[int | None, Line], np.ndarray]:
    """Both as of one moment: read again when somebody has moved returns from here to there in the meantime."""
    while True:
        summed_to, lines, tail = run.summed_to, _blocks(run, by_execution), _tail(run, behind)
        run.refresh_from_db(fields=["summed_to"])
        if run.summed_to == summed_to:
            return lines, tail


def _blocks(run: Run, by_execution: bool) -> dict[int | None, Line]:
    """The blocks of a run, merged by the database into about so many points as are drawn."""
    blocks = CurveBlock.objects.filter(run=run, execution__isnull=not by_execution)
    size = -(-blocks.count() // POINTS) or 1
    pieces = blocks.annotate(piece=F("number") / size, rest=Mod("number", size))
    sums = {"n": Sum("count"), "t": Sum("total"), "s": Sum("squares"), "first": Min("sample", filter=Q(rest=0))}
    rows = pieces.values("execution_id", "piece").annotate(**sums).order_by("execution_id", "piece")
    columns = list(zip(*rows.values_list("execution_id", *sums), strict=True))
    if not columns:
        return {}
    keys, arrays = np.array(columns[0]), [np.array(column, dtype=float) for column in columns[1:]]
    if not by_execution:
        return {None: Line(*arrays)}
    return {key: Line(*(array[keys == key] for array in arrays)) for key in np.unique(keys).tolist()}


def _points(line: Line) -> dict[str, list[float]]:
    """What is drawn: x counts the episodes of the line."""
    counts, totals, squares = (np.concatenate([[0.0], np.cumsum(a)]) for a in (line.count, line.total, line.squares))
    end = np.arange(1, len(counts))
    start = np.maximum(np.searchsorted(counts, counts[end] - WINDOW, side="right") - 1, 0)
    start = np.minimum(start, end - 1)
    number = counts[end] - counts[start]
    mean = (totals[end] - totals[start]) / number
    deviation = np.sqrt(np.maximum((squares[end] - squares[start]) / number - mean**2, 0))
    columns = {"x": counts[end], "value": line.sample, "mean": mean, "deviation": deviation}
    return {name: _rounded(column) for name, column in columns.items()}


def _rounded(column: np.ndarray) -> list[float]:
    """Six digits, which no screen shows the end of."""
    return [float(f"{number:.6g}") for number in column]
