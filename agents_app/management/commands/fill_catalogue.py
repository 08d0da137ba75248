"""`manage.py fill_catalogue`: the tables of algorithms and parameters, from the code."""

from typing import Any

from django.core.management.base import BaseCommand

from agents_app import catalogue
from agents_app.models import Algorithm, Parameter


class Command(BaseCommand):
    """Make the catalogue say what the algorithms' signatures say. Changes nothing when it does already."""

    help = "Fill the tables of algorithms and parameters from the algorithms' own signatures (migrate does it, too)."

    def handle(self, **options: Any) -> None:
        """Fill, and say how many there are."""
        catalogue.fill()
        listed = Algorithm.objects.filter(listed=True)
        self.stdout.write(f"{listed.count()} algorithms, {Parameter.objects.count()} parameters.")
