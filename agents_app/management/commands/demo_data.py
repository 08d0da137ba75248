"""`manage.py demo_data`: something to look at in a new Shepherd."""

from __future__ import annotations

import json
import secrets
from typing import Any

from django.core.management.base import BaseCommand
from django.db import transaction

from agents_app import services
from agents_app.models import Agent, Algorithm, APIKey, User

# PPO as in the RL Zoo of Stable-Baselines3, for one environment instead of eight or sixteen.
DEMOS: dict[str, dict[str, Any]] = {
    "CartPole demo": {
        "action_space": 2,
        "observation_space": [[4], -1000, 1000],
        "parameters": {
            "n_steps": 256,
            "batch_size": 64,
            "n_epochs": 10,
            "gamma": 0.98,
            "gae_lambda": 0.9,
            "learning_rate": 0.001,
        },
    },
    "Lunar Lander demo": {
        "action_space": 4,
        "observation_space": [[8], -100, 100],
        "parameters": {
            "n_steps": 2048,
            "batch_size": 64,
            "n_epochs": 10,
            "gamma": 0.999,
            "gae_lambda": 0.98,
            "ent_coef": 0.01,
        },
    },
}


class Command(BaseCommand):
    """Make the superuser `admin` and two agents, unless they exist; print new secrets once, as one line of JSON."""

    help = "Make a superuser 'admin' and two demo agents; print what was newly made, with its secrets, as JSON."

    @transaction.atomic
    def handle(self, **options: Any) -> None:
        """Make what is missing."""
        made: dict[str, Any] = {}
        owner = User.objects.filter(name="admin").first()
        if owner is None:
            made["admin"] = {"name": "admin", "password": secrets.token_urlsafe(12)}
            owner = User.objects.create_superuser(**made["admin"])
        for name, demo in DEMOS.items():
            if not Agent.objects.filter(owner=owner, name=name).exists():
                made.setdefault("agents", []).append(make_agent(owner, name, **demo))
        if made:
            self.stdout.write(json.dumps(made))


def make_agent(owner: User, name: str, parameters: dict[str, Any], **spaces: Any) -> dict[str, str]:
    """The agent, with a key; as the JSON says it."""
    fields = {"name": name, "algorithm": Algorithm.objects.get(name="PPO"), **spaces}
    agent = services.create_agent(owner, fields, parameters)
    return {"id": str(agent.pk), "name": name, "api_key": APIKey.issue(agent, name="demo")[1]}
