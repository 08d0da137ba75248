"""`manage.py scaled`: the whole scaled-out set-up on this machine, for trying, tests and benchmarks."""

from __future__ import annotations

from argparse import ArgumentParser
from typing import Any

from django.conf import settings
from django.core.management.base import CommandError

from envs_app.management.commands import serve
from envs_app.serving.scaled import Scale


class Command(serve.Command):
    """As `serve`, with Celery workers and the housekeeping beside the web processes."""

    help = "Serve with web processes, Celery workers and beat on this machine, against DATABASE_URL and REDIS_URL."

    def add_arguments(self, parser: ArgumentParser) -> None:
        """How many of each."""
        super().add_arguments(parser)
        parser.add_argument("--webs", type=int, default=2, help="Web processes on the one port.")
        parser.add_argument("--workers", type=int, default=2, help="Celery workers, of SHEPHERD_SLOTS executions each.")

    def handle(self, *args: Any, webs: int, workers: int, **options: Any) -> None:  # type: ignore[override]
        """Serve."""
        if settings.TRANSPORT != "redis":
            raise CommandError("Shepherd cannot start: set REDIS_URL, for example redis://127.0.0.1:6379/0.")
        self.scale = Scale(webs, workers, beat=True)
        super().handle(*args, **options)
