"""A million EpisodeReturns: how long the admin page of the agent and its curve take. `python benchmarks/curve.py`.

In a database of its own, in a temporary folder; prints one line of JSON. Cold: the first time, with nothing of the
curve summed up yet. `benchmarks/million.py` makes a row of it, beside the bar of 500 ms.
"""

from __future__ import annotations

import io
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

RETURNS, EXECUTIONS, REPEATS = int(os.environ.get("RETURNS", 1_000_000)), 8, 9


def main() -> None:
    """Fill, measure, print."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ |= {"SHEPHERD_DATA": folder, "DJANGO_SETTINGS_MODULE": "shepherd.settings"}
        os.environ.pop("DATABASE_URL", None)
        sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
        import django

        django.setup()
        print(json.dumps(measure() | {"returns": RETURNS, "executions": EXECUTIONS}))


def measure() -> dict[str, Any]:
    """Milliseconds of each call; the size of the answer."""
    from django.core.management import call_command
    from django.test import Client

    from agents_app import curves
    from agents_app.models import Agent, User

    call_command("migrate", verbosity=0)
    call_command("demo_data", stdout=io.StringIO())
    agent = Agent.objects.get(name="CartPole demo")
    run = agent.current_run()
    fill(run)
    client = Client()
    client.force_login(User.objects.get(name="admin"))
    page, curve = f"/admin/agents_app/agent/{agent.pk}/change/", f"/admin/agents_app/agent/{agent.pk}/curve/"
    client.get("/admin/")
    result: dict[str, Any] = {
        "page_cold_ms": once(lambda: client.get(page)),
        "curve_cold_ms": once(lambda: client.get(curve)),
    }
    start = time.perf_counter()
    while curves.catch_up():
        pass
    result["catch_up_s"] = round(time.perf_counter() - start, 2)
    result["page_ms"] = several(lambda: client.get(page))
    result["curve_ms"] = several(lambda: client.get(curve))
    result["curve_by_execution_ms"] = several(lambda: client.get(curve + "?by=execution"))
    result["poll_without_news_ms"] = several(lambda: client.get(f"{curve}?version={curves.version(run)}"))
    result["curve_bytes"] = len(client.get(curve).content)
    result["points"] = len(client.get(curve).json()["lines"][0]["x"])
    return result


def fill(run: Any) -> None:
    """Returns of several executions by turns, rising from 20 to 500."""
    import numpy as np

    from agents_app.models import EpisodeReturn

    executions = [run.executions.create(number=number) for number in range(1, EXECUTIONS + 1)]
    random = np.random.default_rng(0)
    when = run.started_at.__class__(2026, 1, 1, tzinfo=run.started_at.tzinfo)
    for first in range(0, RETURNS, 20_000):
        share = np.arange(first, min(first + 20_000, RETURNS)) / RETURNS
        values = 20 + 480 * share + random.normal(0, 40, len(share))
        EpisodeReturn.objects.bulk_create(
            EpisodeReturn(
                run=run, execution=executions[i % EXECUTIONS], episode=i, value=value, length=100, created_at=when
            )
            for i, value in enumerate(values, first)
        )


def once(call: Callable[[], Any]) -> dict[str, float]:
    """Milliseconds of a call that must succeed, by the clock and of the processor (the machine may be busy)."""
    clock, processor = time.perf_counter(), time.process_time()
    assert call().status_code == 200
    clock, processor = time.perf_counter() - clock, time.process_time() - processor
    return {"clock": round(clock * 1000, 1), "processor": round(processor * 1000, 1)}


def several(call: Callable[[], Any]) -> dict[str, float]:
    """The median and the worst of some calls."""
    times = sorted((once(call) for _ in range(REPEATS)), key=lambda time: time["clock"])
    return times[REPEATS // 2] | {"worst": times[-1]["clock"]}


if __name__ == "__main__":
    main()
