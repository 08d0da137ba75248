"""`manage.py demo_data`: something to look at in a new Shepherd."""

from __future__ import annotations

import json
import secrets
from argparse import ArgumentParser
from typing import Any

from django.core.management.base import BaseCommand
from django.db import transaction

from agents_app import services
from agents_app.demos import DEMOS
from agents_app.models import Agent, Algorithm, APIKey, User


class Command(BaseCommand):
    """Make the superuser `admin` and three agents, unless they exist; print new secrets once, as one line of JSON."""

    help = "Make a superuser 'admin' and three demo agents; print what was newly made, with its secrets, as JSON."

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Whether what somebody has deleted comes back."""
        parser.add_argument("--if-new", action="store_true", help="make nothing where there is a user already")

    @transaction.atomic
    def handle(self, *, if_new: bool, **options: Any) -> None:
        """Make what is missing."""
        made: dict[str, Any] = {}
        if if_new and User.objects.exists():
            return
        owner = User.objects.filter(name="admin").first()
        if owner is None:
            made["admin"] = {"name": "admin", "password": secrets.token_urlsafe(12)}
            owner = User.objects.create_superuser(**made["admin"])
        for name, demo in DEMOS.items():
            if not Agent.objects.filter(owner=owner, name=name).exists():
                made.setdefault("agents", []).append(make_agent(owner, name, **demo))
        if made:
            self.stdout.write(json.dumps(made))


def make_agent(
    owner: User,
    name: str,
    parameters: dict[str, Any],
    algorithm: str = "PPO",
    publishable: bool = False,
    **fields: Any,
) -> dict[str, str]:
    """The agent, with a key, and one for web pages if it is `publishable`; as the JSON says it."""
    fields |= {"name": name, "algorithm": Algorithm.objects.get(name=algorithm)}
    agent = services.create_agent(owner, fields, parameters)
    if publishable:
        APIKey.issue(agent, name="web page", publishable=True)
    return {"id": str(agent.pk), "name": name, "api_key": APIKey.issue(agent, name="demo")[1]}
