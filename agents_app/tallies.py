"""How often each action was chosen, and how it was rewarded, by the hour of the day: of agents whose episodes have one step.

Sums, and nothing else: which session an episode belonged to is not in them. The hour is that in which the action was chosen, in
the agent's time zone (`Agent.counted_in`), however late its reward came.
"""

from __future__ import annotations

from datetime import datetime
from typing import Any
from zoneinfo import ZoneInfo

from django.db.models import F, Sum

from agents_app.models import ActionTally, Run


def count(run: int, zone: str, action: int, chosen_at: float, reward: float) -> None:
    """Add an episode to the sums; within the transaction that records it. `chosen_at`: seconds since the epoch."""
    hour = datetime.fromtimestamp(chosen_at, ZoneInfo(zone)).hour
    row, _ = ActionTally.objects.get_or_create(run_id=run, action=action, hour=hour)
    ActionTally.objects.filter(pk=row.pk).update(count=F("count") + 1, total=F("total") + reward)


def read(run: Run) -> dict[str, Any]:
    """The sums for the page. `rows` are [action, hour, count, total]; `version` counts the episodes, and so only grows."""
    rows = list(ActionTally.objects.filter(run=run).values_list("action", "hour", "count", "total"))
    return {"version": sum(row[2] for row in rows), "rows": rows}


def version(run: Run) -> int:
    """How many episodes are counted; a reader who has as many has all."""
    return ActionTally.objects.filter(run=run).aggregate(all=Sum("count"))["all"] or 0
