"""Agents and users for tests, and a fleet that runs nothing but remembers what it was asked."""

from __future__ import annotations

from io import BytesIO
from typing import Any

from agents_app import services
from agents_app.models import Agent, Algorithm, User

VECTOR = [[8], -10, 10]


def make_user(name: str, **fields: Any) -> User:
    """The user of that name."""
    return User.objects.filter(name=name).first() or User.objects.create_user(name, **fields)


def make_staff(name: str) -> User:
    """A user who may log in to the admin."""
    return make_user(name, password="secret-password", is_staff=True)


def make_agent(name: str = "agent", owner: str | User = "owner", parameters: Any = None, **fields: Any) -> Agent:
    """An agent that is checked as any other."""
    owner = make_user(owner) if isinstance(owner, str) else owner
    fields = {"action_space": 4, "observation_space": VECTOR, "algorithm": "PPO"} | fields
    fields["algorithm"] = Algorithm.objects.get(name=fields["algorithm"])
    return services.create_agent(owner, fields | {"name": name}, parameters or {})


class RecordingFleet:
    """A fleet without executions. `calls` are (method, argument...); `statuses` and `zip` are what tests put there."""

    calls: list[tuple[Any, ...]] = []
    statuses: list[Any] = []
    zip: BytesIO | None = None
    unreachable = False

    def __getattr__(self, name: str) -> Any:
        answers = {"status": self.statuses, "restart": 2, "model_zip": self.zip, "delete_saves": 3, "saves": []}

        def answer(*arguments: Any) -> Any:
            if RecordingFleet.unreachable:
                raise ConnectionError("nobody there")
            RecordingFleet.calls.append((name, *arguments))
            return answers.get(name)

        return answer
