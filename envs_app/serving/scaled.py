"""Scaled out: web processes behind one port, Celery workers and the housekeeping, as a machine of many would run them.

manage.py scaled ─┬─ worker1, worker2   celery -A shepherd worker -Q small,large
                  ├─ beat               celery -A shepherd worker --beat --pool solo -Q housekeeping
                  └─ web1, web2         granian, on one listening socket

`manage.py serve` is the web alone where REDIS_URL is set: the rest runs elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from envs_app.serving.child import Child
from envs_app.serving.supervisor import Options, Supervisor

LEAN = ("--without-mingle", "--without-gossip", "--without-heartbeat")  # workers need not know each other


@dataclass(frozen=True)
class Scale:
    """How many of each."""

    webs: int = 1
    workers: int = 0
    beat: bool = False


class ScaledSupervisor(Supervisor):
    """Runs some parts of a scaled-out set-up, and starts again what dies."""

    def __init__(
        self, options: Options, say: Callable[[str], None], scale: Scale, count_machines: Callable[[], int]
    ) -> None:
        """`count_machines`: how many workers have said that they live, wherever they are. Raises ConnectionError."""
        self.scale, self.count_machines = scale, count_machines
        super().__init__(replace(options, workers=1) if scale.webs > 1 else options, say)

    def _make_executions(self) -> list[Child]:
        workers = [self._celery(f"worker{n + 1}", "-Q", "small,large") for n in range(self.scale.workers)]
        beat = ["--beat", "--pool", "solo", "-Q", "housekeeping"]
        return [*workers, *([self._celery("beat", *beat)] if self.scale.beat else [])]

    def _make_web(self) -> list[Child]:
        return [self._web_child(f"web{n + 1}" if self.scale.webs > 1 else "web") for n in range(self.scale.webs)]

    def _celery(self, name: str, *arguments: str) -> Child:
        return self._child(name, "celery", "-A", "shepherd", "worker", "-n", f"{name}@%h", *LEAN, *arguments)

    def _before(self) -> None:
        """The workers; the housekeeping needs the database."""
        for child in self.executions[: self.scale.workers]:
            self._start(child)

    def _keep_house(self) -> None:
        """The beat does it."""

    def _executions_listen(self) -> bool:
        try:
            return self.count_machines() >= self.scale.workers
        except ConnectionError:
            return False
