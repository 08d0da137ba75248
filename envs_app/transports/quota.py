"""The CPU quota of an agent: a bucket that fills with its share of a CPU and is emptied by what its executions use."""

from __future__ import annotations

BURST_SECONDS = 5.0  # of its share may be used at once; so a minute holds at most a twelfth more than the share


class Bucket:
    """CPU seconds that an agent may still use. Refusals come in short, even pauses, not in whole minutes."""

    def __init__(self, percent: float) -> None:
        """`percent` of one CPU."""
        self.percent = percent
        self.level = self.capacity

    @property
    def rate(self) -> float:
        """CPU seconds that it gains each second."""
        return self.percent / 100

    @property
    def capacity(self) -> float:
        """CPU seconds that it holds when full."""
        return self.rate * BURST_SECONDS

    def use(self, cpu_seconds: float, elapsed: float) -> float:
        """Account for what was used in `elapsed` seconds; returns how many seconds the agent must pause now."""
        self.level = min(self.capacity, self.level + self.rate * elapsed - cpu_seconds)
        return max(0.0, -self.level / self.rate)
