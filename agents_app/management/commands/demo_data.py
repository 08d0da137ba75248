"""`manage.py demo_data`: something to look at in a new Shepherd."""

from __future__ import annotations

import json
import secrets
from argparse import ArgumentParser
from typing import Any

from django.conf import settings
from django.core.management.base import BaseCommand
from django.db import transaction

from agents_app import services
from agents_app.models import Agent, Algorithm, APIKey, User

PLACES = json.loads((settings.BASE_DIR / "frontend" / "bored" / "places.json").read_text("utf-8"))["places"]
TYPES = ("restaurant", "asian_restaurant", "shop", "thriftshop", "cafe", "bar", "sightseeing")
BOX = ((50.840, 50.857), (4.338, 4.366))  # latitudes and longitudes that become -1 to 1


def features(place: dict[str, Any]) -> list[float]:
    """What the agent knows of a place, as docs/bored.md has it: its type, and where it is."""
    ends = zip((place["lat"], place["lon"]), BOX, strict=True)
    y, x = (2.0 * (value - low) / (high - low) - 1.0 for value, (low, high) in ends)
    return [*(float(kind == place["type"]) for kind in TYPES), y, x, y * y + x * x]


# The first two: PPO as in the RL Zoo of Stable-Baselines3, for one environment instead of eight or sixteen.
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
    # One-step episodes of many visitors, whose page finds the agent by its name and shows its key. All share an execution:
    # docs/bored.md has the comparison.
    "Bored in the city": {
        "algorithm": "DQN",
        "action_space": len(PLACES),
        "observation_space": [[29], -1, 1],
        "action_masks": True,
        "action_features": [features(place) for place in PLACES],
        "sessions_per_execution": 1000,
        "answer_within": 15 * 60,
        "save_interval": 64,
        "public": True,  # its page is there for everybody, too
        "counted_in": "Europe/Brussels",
        "parameters": {
            "gamma": 0.0,
            "net_arch": "0",
            "learning_rate": 0.003,
            "buffer_size": 20_000,
            "learning_starts": 50,
            "batch_size": 256,
            "train_freq": 4,
            "gradient_steps": 1,
            "target_update_interval": 1,
            "exploration_fraction": 0.05,
            "exploration_final_eps": 0.05,
            "total_timesteps": 20_000,
        },
        "publishable": True,
    },
}


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
