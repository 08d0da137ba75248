"""The Django application of agents."""

from typing import Any

from django.apps import AppConfig
from django.db import connections
from django.db.models.signals import post_migrate


class AgentsConfig(AppConfig):
    """What an agent is: models, catalogue, admin, learning curves."""

    name = "agents_app"
    verbose_name = "Agents"

    def ready(self) -> None:
        """Keep the catalogue of algorithms up to date with the code."""
        post_migrate.connect(fill_catalogue, sender=self)


def fill_catalogue(using: str, **kwargs: Any) -> None:
    """Fill the catalogue after a migration, unless it was one that took the tables away."""
    from agents_app import catalogue
    from agents_app.models import Parameter

    if Parameter._meta.db_table in connections[using].introspection.table_names():
        catalogue.fill(using)
