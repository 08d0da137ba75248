"""`manage.py demo`: a server, and a real client that trains an agent on it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from argparse import ArgumentParser
from typing import Any

from django.conf import settings
from django.core.management.base import BaseCommand, CommandError
from django.db import connections
from django.utils import timezone

from agents_app.models import Agent, APIKey
from envs_app.serving import bond, manage, preflight

AGENT = "CartPole demo"
KEY_NAME = "make demo"
START_SECONDS = 90


class Interrupted(Exception):
    """Ctrl-C or SIGTERM."""


class Command(BaseCommand):
    """Serves, trains the demo agent with the Python client over HTTP, says where to look, and goes on serving."""

    help = "Serve, and train the demo agent on Cart Pole with a real client. Ctrl-C ends it."

    def add_arguments(self, parser: ArgumentParser) -> None:
        """How long to train."""
        parser.add_argument("--steps", type=int, default=20_000, help="environment steps to train for")

    def handle(self, *args: Any, steps: int, **options: Any) -> None:
        """Run the demo until Ctrl-C."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, _interrupt)
        try:
            self._demo(steps)
        except Interrupted:
            return
        except preflight.StartError as error:
            raise CommandError(f"Shepherd cannot start: {error}") from None

    def _demo(self, steps: int) -> None:
        credentials, key, agent = make_data()
        server = start("manage.py", "serve")
        try:
            url = wait_for_url(server)
            self.stdout.write(f"\nA client plays Cart Pole at {url} and sends what happens; the agent learns:\n")
            self.stdout.flush()
            train(url, key, steps)
            self.stdout.write(where_to_look(url, agent, credentials))
            self.stdout.flush()
            server.wait()
        finally:
            stop(server)
        if server.returncode:
            raise CommandError("the server ended")


def _interrupt(*_: Any) -> None:
    raise Interrupted


def make_data() -> tuple[dict[str, Any], str, Agent]:
    """The demo data. Returns what is newly made, a key for the client (the last demo's is revoked), and the agent."""
    preflight.check_disk(settings.DATA_DIR, settings.MIN_FREE_MB)
    credentials = manage.prepare(demo_data=True)
    agent = Agent.objects.get(owner__name="admin", name=AGENT)
    APIKey.objects.filter(agent=agent, name=KEY_NAME, revoked_at=None).update(revoked_at=timezone.now())
    _, key = APIKey.issue(agent, name=KEY_NAME, scope=APIKey.Scope.STEP)
    connections.close_all()
    return credentials, key, agent


def start(*arguments: str, **environment: str) -> subprocess.Popen[bytes]:
    """Start Python with these arguments, in a group of its own and bound to this process."""
    command = [sys.executable, "-I", "-S", bond.__file__, str(os.getpid()), sys.executable, *arguments]
    environment = os.environ | {"SHEPHERD_DATA": str(settings.DATA_DIR)} | environment
    return subprocess.Popen(command, cwd=settings.BASE_DIR, env=environment, process_group=0)  # noqa: S603


def wait_for_url(server: subprocess.Popen[bytes]) -> str:
    """Where the server serves, once it is ready."""
    state = settings.DATA_DIR / "run" / "serve.json"
    deadline = time.monotonic() + START_SECONDS
    while time.monotonic() < deadline:
        if server.poll() is not None:
            raise CommandError("the server did not start", returncode=server.returncode)
        if state.exists() and (told := json.loads(state.read_text()))["pid"] == server.pid and told["ready"]:
            return told["url"]
        time.sleep(0.1)
    stop(server)
    raise CommandError(f"the server is not ready after {START_SECONDS} s: see {settings.LOG_DIR or 'above'}")


def train(url: str, key: str, steps: int) -> None:
    """Play Cart Pole through the client, under its progress bar."""
    arguments = ["-m", "shepherd_client", "--env", "CartPole-v1", "--steps", str(steps), "--url", url]
    client = start(*arguments, SHEPHERD_API_KEY=key)
    try:
        if client.wait():
            raise CommandError("the client failed, see above")
    finally:
        stop(client)


def stop(process: subprocess.Popen[bytes]) -> None:
    """End a process in order; at a second Ctrl-C, which comes as an Interrupted, ask again, which forces the end."""
    while process.poll() is None:
        process.terminate()
        try:
            process.wait()
        except Interrupted:
            continue


def where_to_look(url: str, agent: Agent, credentials: dict[str, Any]) -> str:
    """What a newcomer does next."""
    admin = credentials.get("admin")
    login = (
        f"name {admin['name']}, password {admin['password']} (shown this once)"
        if admin
        else "as before; forgotten: .venv/bin/python manage.py changepassword admin"
    )
    return f"""
Where to look now (the learning curve is on the page of the agent):
  administration   {url}admin/agents_app/agent/{agent.pk}/change/
  watch it learn   {url}agents/{agent.pk}/   (once logged in; for everybody, when you tick that it is public)
  log in           {login}
  API              {url}api/docs/
  a page to try    {url}bored/   (Bored in the city: its visitors train an agent)
  go on training   make an API key on the agent's page, then
                   SHEPHERD_API_KEY=... .venv/bin/shepherd-client --env CartPole-v1 --url {url}
Serving until Ctrl-C, which saves what was learned.
"""
