"""`manage.py serve`: the whole of Shepherd on this machine."""

from __future__ import annotations

import logging
import os
from argparse import ArgumentParser
from contextlib import suppress
from typing import Any

from django.conf import settings
from django.core.management.base import BaseCommand, CommandError

from envs_app.serving import preflight
from envs_app.serving.manage import prepare
from envs_app.serving.scaled import Scale, ScaledSupervisor
from envs_app.serving.supervisor import Options, Supervisor
from shepherd import env


class Command(BaseCommand):
    """Prepares the data folder, then runs the supervisor until SIGTERM or Ctrl-C."""

    help = "Serve the web pages, the API and the executions on this machine, until Ctrl-C."

    scale = Scale()

    def add_arguments(self, parser: ArgumentParser) -> None:
        """The address, and whether to make something to look at."""
        parser.add_argument("--host", default=env.text("HOST", "127.0.0.1"), help="Address to listen on (HOST).")
        parser.add_argument("--port", type=int, default=env.integer("PORT", 8000), help="Port (PORT); 0: a free one.")
        parser.add_argument(
            "--demo-data", action="store_true", help="In a new database, make demo agents and an administrator."
        )

    def handle(self, *args: Any, host: str, port: int, demo_data: bool, **options: Any) -> None:
        """Serve. A failed start is one line and exit code 1."""
        try:
            self._serve(host, port, demo_data)
        except preflight.StartError as error:
            raise CommandError(f"Shepherd cannot start: {error}") from None
        except KeyboardInterrupt:
            raise CommandError("interrupted before anything was started", returncode=130) from None

    def _serve(self, host: str, port: int, demo_data: bool) -> None:
        os.umask(0o077)  # what was learned, and who may log in, is for this user only
        preflight.check_disk(settings.DATA_DIR, settings.MIN_FREE_MB)
        preflight.raise_file_limit()
        supervisor = self._supervisor(_options(host, port))
        _log_to(settings.LOG_DIR)
        settings.STATIC_ROOT.mkdir(parents=True, exist_ok=True)
        supervisor.run(
            lambda: prepare(demo_data, if_new=True), lambda credentials: self._announce(supervisor.url, credentials)
        )
        self._say("Shepherd has ended.")

    def _supervisor(self, options: Options) -> Supervisor:
        """Where executions come through Redis, they run elsewhere."""
        if settings.TRANSPORT == "local":
            return Supervisor(options, self._say)
        from envs_app.transports.redis.machines import Room
        from envs_app.transports.redis.wire import Wire

        room = Room(Wire(settings.REDIS_URL))
        return ScaledSupervisor(options, self._say, self.scale, lambda: len(room.machines()))

    def _announce(self, url: str, credentials: dict[str, Any]) -> None:
        self._say(f"Shepherd is ready: {url}")
        self._say(f"  administration   {url}admin/")
        self._say(f"  API              {url}api/docs/")
        self._say(f"  a page to try    {url}bored/")
        if admin := credentials.get("admin"):
            self._say(f"  log in           name {admin['name']}, password {admin['password']}")
        for agent in credentials.get("agents", []):
            self._say(f"  API key          {agent['api_key']} of {agent['name']}")
        if credentials:
            self._say("Password and keys are shown this once: keep them.")
        self._say("Ctrl-C ends it and saves.")

    def _say(self, line: str) -> None:
        """Print for people; a terminal that is gone (closed window, ended pipe) is no reason to fail."""
        with suppress(OSError):
            self.stdout.write(line)
            self.stdout.flush()


def _options(host: str, port: int) -> Options:
    return Options(
        host=host,
        port=port,
        data=settings.DATA_DIR,
        project=settings.BASE_DIR,
        workers=settings.WEB_WORKERS,
        threads=settings.WEB_THREADS,
        step_timeout=settings.STEP_TIMEOUT,
        logs=settings.LOG_DIR,
    )


def _log_to(folder: Any) -> None:
    """The supervisor's own errors go where the other logs are, not over what it says to people."""
    handler = logging.FileHandler(folder / "serve.log") if folder else logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
    logging.getLogger("shepherd.serve").addHandler(handler)
    logging.getLogger("shepherd.serve").propagate = False
