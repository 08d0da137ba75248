"""The CPU quota holds over a minute, and its pauses are short and even."""

from __future__ import annotations

import pytest

from envs_app.transports.quota import BURST_SECONDS, Bucket

TICK = 0.5  # of the parent: it measures, and tells the executions how long they must pause from now on
MOMENT = 0.01


def work(percent: float, demand: float, seconds: float) -> tuple[list[float], float]:
    """An agent that uses `demand` CPUs whenever it is let. What it used in each tick, and its longest pause."""
    bucket, used, since_tick = Bucket(percent), [], 0.0
    paused_until = pausing = longest = 0.0
    for moment in range(int(seconds / MOMENT)):
        now = moment * MOMENT
        works = now >= paused_until
        since_tick += demand * MOMENT * works
        pausing = 0.0 if works else pausing + MOMENT
        longest = max(longest, pausing)
        if moment % round(TICK / MOMENT) == 0:
            if pause := bucket.use(since_tick, TICK):
                paused_until = now + pause
            used.append(since_tick)
            since_tick = 0.0
    return used, longest


@pytest.mark.parametrize("percent", [10, 50, 100, 150])
def test_over_any_minute_an_agent_gets_its_share_and_little_more(percent: float) -> None:
    used, _ = work(percent, demand=2.0, seconds=300)
    window = int(60 / TICK)
    most = max(sum(used[start : start + window]) for start in range(len(used) - window))
    share = 60 * percent / 100
    assert most <= share * (1 + BURST_SECONDS / 60) + 2 * TICK * 2.0
    assert sum(used) >= 0.9 * 300 * percent / 100, "it gets what it may have"


@pytest.mark.parametrize("percent", [10, 50, 100])
def test_pauses_are_short(percent: float) -> None:
    _, longest = work(percent, demand=2.0, seconds=120)
    assert 0 < longest <= 2.0 * TICK / (percent / 100) + TICK, "what one tick can overdraw"


def test_who_stays_within_the_share_never_pauses() -> None:
    assert work(50, demand=0.45, seconds=300)[1] == 0.0


def test_who_rested_may_use_a_burst() -> None:
    bucket = Bucket(50)
    assert bucket.use(0.0, 1000.0) == 0.0
    assert bucket.use(BURST_SECONDS * 0.5, 0.0) == 0.0
    assert bucket.use(1.0, 0.0) == pytest.approx(2.0)
