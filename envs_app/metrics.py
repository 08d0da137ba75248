"""Prometheus metrics of the web processes, summed over all of them.

prometheus_client keeps the values of each process in a file of one folder. The folder bears the id of the process that
started the web processes, so that all of one server meet in it, and those of dead servers are deleted.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from functools import cache
from math import inf
from pathlib import Path
from uuid import UUID

import psutil
import structlog
from django.conf import settings

FOLDER_VARIABLE = "PROMETHEUS_MULTIPROC_DIR"
os.environ.setdefault(FOLDER_VARIABLE, "")  # prometheus_client, when it is imported, asks only whether it is set

from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, Histogram, generate_latest  # noqa: E402
from prometheus_client.core import GaugeMetricFamily, Metric  # noqa: E402
from prometheus_client.multiprocess import MultiProcessCollector  # noqa: E402

from agents_app.fleet import get_fleet  # noqa: E402
from agents_app.models import Execution, Session  # noqa: E402

log = structlog.get_logger("shepherd.http")

CONTENT_TYPE = CONTENT_TYPE_LATEST
BUCKETS = (0.0005, 0.001, 0.002, 0.003, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 5, 20)
RETRY_SECONDS = 60.0
FILE_SIZE = 2**18  # bytes; room for the values of every code

_step_seconds = Histogram(
    "shepherd_step_seconds",
    "Steps by what was answered ('ok' or the code of the error), and the seconds they took in the web process.",
    ["code"],
    buckets=BUCKETS,
    registry=None,
)


class _ByCode(dict[str, Histogram | None]):
    """The histogram of each code, made on first use; where that fails, it is tried again after a minute."""

    failed_at = -inf

    def __missing__(self, code: str) -> Histogram | None:
        if time.monotonic() - self.failed_at < RETRY_SECONDS:
            return None
        try:
            _folder()
            histogram = self[code] = _step_seconds.labels(code)
        except OSError as error:
            self.failed_at = time.monotonic()
            log.warning("metrics cannot be kept", reason=str(error))
            return None
        return histogram


_by_code = _ByCode()


def observe_step(code: str, seconds: float) -> None:
    """Count a step. A full disk loses the count, not the step."""
    if (histogram := _by_code[code]) is not None:
        histogram.observe(seconds)


def render() -> bytes:
    """Everything, in Prometheus' text format."""
    registry = CollectorRegistry()
    MultiProcessCollector(registry, str(_folder()))
    registry.register(Now())
    return generate_latest(registry)


class Now:
    """What is counted at the time of asking."""

    def collect(self) -> Iterator[Metric]:
        """Open sessions, and the live executions of each agent."""
        sessions = Session.objects.filter(closed_at=None).count()
        yield GaugeMetricFamily("shepherd_sessions", "Sessions that are not closed.", sessions)
        executions = GaugeMetricFamily("shepherd_executions", "Live executions of an agent.", labels=["agent"])
        for agent, number in _count_executions().items():
            executions.add_metric([str(agent)], number)
        yield executions


def _count_executions() -> dict[UUID, int]:
    """Live executions by agent, as the fleet tells; none while it cannot be asked."""
    agents = Execution.objects.filter(ended_at=None).order_by().values_list("run__agent", flat=True).distinct()
    try:
        return {agent: len(get_fleet().status(str(agent))) for agent in agents}
    except ConnectionError:
        return {}


@cache
def _folder() -> Path:
    """This server's folder, with this process's file; those of dead servers are deleted.

    The file's room is taken from the disk at once: prometheus_client maps a sparse file into memory, and the kernel
    ends a process that writes to such a page when the disk is full.
    """
    folder = Path(settings.DATA_DIR) / "metrics" / str(os.getppid())
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / f"histogram_{os.getpid()}.db").open("ab") as file:
        os.posix_fallocate(file.fileno(), 0, FILE_SIZE)
    for other in folder.parent.iterdir():
        if other.name.isdigit() and not psutil.pid_exists(int(other.name)):
            shutil.rmtree(other, ignore_errors=True)
    os.environ[FOLDER_VARIABLE] = str(folder)
    return folder
