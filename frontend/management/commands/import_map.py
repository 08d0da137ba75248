"""`manage.py import_map`: a full street map for Bored in the city, from an extract of OpenStreetMap."""

from __future__ import annotations

import json
from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError

from frontend.bored_pages import map_file
from frontend.street_map import Feature, convert

ATTRIBUTION = "© OpenStreetMap contributors"


class Command(BaseCommand):
    """Reads GeoJSON files and writes the map that the page draws in place of its sketch."""

    help = "Make a full street map for Bored in the city, from an extract of OpenStreetMap in GeoJSON."

    def add_arguments(self, parser: ArgumentParser) -> None:
        """The extract, and where the map goes."""
        parser.add_argument("extracts", nargs="+", type=Path, help="GeoJSON files with streets, areas and stations")
        parser.add_argument("--output", type=Path, help="for another host than Shepherd; default: the data folder")
        parser.add_argument("--attribution", default=ATTRIBUTION, help=f"shown on the map (default: {ATTRIBUTION})")

    def handle(self, *, extracts: list[Path], output: Path | None, attribution: str, **options: Any) -> None:
        """Convert all, or write nothing."""
        found = convert((feature for extract in extracts for feature in read(extract)), attribution)
        if not found["streets"]:
            raise CommandError("There is no street of the centre of Brussels in there: is it GeoJSON, longitude first?")
        target = output or map_file()
        target.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps(found, ensure_ascii=False, separators=(",", ":"))
        target.write_text(text, encoding="utf-8")
        counts = ", ".join(f"{len(found[room])} {room}" for room in ("streets", "areas", "stations"))
        self.stdout.write(f"{counts}: {target} ({len(text.encode()) // 1000} kB)")


def read(extract: Path) -> list[Feature]:
    """The features of a file. Raises CommandError if it has none."""
    try:
        return list(json.loads(extract.read_text(encoding="utf-8"))["features"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CommandError(f"{extract} is no GeoJSON FeatureCollection: {error}") from None
