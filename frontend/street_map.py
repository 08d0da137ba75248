"""A street map for Bored in the city, from an extract of OpenStreetMap as GeoJSON (RFC 7946).

Features carry the tags of OpenStreetMap (`highway`, `leisure`, `name`, `name:nl`, ...) as properties, as osmium and Overpass
write them, or `kind`, `name` and `name_nl`. What comes out is what frontend/bored/js/drawing.js draws.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

Point = tuple[float, float]  # latitude, longitude: the order of Leaflet, not of GeoJSON
Feature = dict[str, Any]

BOX = ((50.840, 4.338), (50.857, 4.366))  # south-west and north-east corner, as in docs/bored.md
MARGIN = 0.002  # degrees around the box that are kept, too
DECIMALS = 5  # of a degree: a metre

STREETS = {
    "main": {"motorway", "trunk", "primary", "secondary", "tertiary", "major"},
    "street": {"residential", "unclassified", "living_street", "service", "medium", "minor"},
    "foot": {"pedestrian", "footway", "path", "steps", "cycleway"},
}
AREAS = {
    "park": {"park", "garden", "grass", "green", "village_green", "playground"},
    "water": {"water", "riverbank", "basin"},
    "square": {"square", "pedestrian"},
    "building": {"building"},
}
STATIONS = {"subway", "metro", "station"}
STREET_TAGS, AREA_TAGS = ("kind", "highway"), ("kind", "leisure", "landuse", "natural", "waterway", "place", "highway")
STATION_TAGS = ("kind", "station", "railway")


def convert(features: Iterable[Feature], attribution: str) -> dict[str, Any]:
    """The map of what lies in the box and can be drawn; the rest is left out."""
    found: dict[str, Any] = {"attribution": attribution, "streets": [], "areas": [], "stations": []}
    for feature in features:
        names = names_of(feature.get("properties") or {})
        for room, shape in shapes(feature):
            found[room].append(names | shape)
    return found


def shapes(feature: Feature) -> Iterator[tuple[str, dict[str, Any]]]:
    """What a feature is on the map: the list that it belongs to, and its shape."""
    tags, geometry = feature.get("properties") or {}, feature.get("geometry") or {}
    kind, coordinates = geometry.get("type", ""), geometry.get("coordinates", [])
    many = coordinates if kind.startswith("Multi") else [coordinates]
    if kind.endswith("LineString") and (street := classify(tags, STREET_TAGS, STREETS)):
        yield from (("streets", {"kind": street, "line": line}) for line in map(points, many) if is_inside(line))
    elif kind.endswith("Polygon") and (area := area_of(tags)):
        outlines = (points(rings[0]) for rings in many if rings)
        yield from (("areas", {"kind": area, "ring": ring}) for ring in outlines if is_inside(ring))
    elif kind == "Point" and STATIONS & {tags.get(tag) for tag in STATION_TAGS} and is_inside(points([coordinates])):
        yield "stations", {"at": points([coordinates])[0]}


def classify(tags: dict[str, Any], names: Iterable[str], kinds: dict[str, set[str]]) -> str | None:
    """The first kind that a tag says; None: none does."""
    values = {tags.get(name) for name in names}
    return next((kind for kind, known in kinds.items() if values & known), None)


def area_of(tags: dict[str, Any]) -> str | None:
    """The kind of an area; None: none that is drawn."""
    return classify(tags, AREA_TAGS, AREAS) or ("building" if tags.get("building") else None)


def names_of(tags: dict[str, Any]) -> dict[str, str]:
    """The names in French and in Dutch, as far as they are given."""
    french = tags.get("name:fr") or tags.get("name") or ""
    dutch = tags.get("name:nl") or tags.get("name_nl") or ""
    return {language: name for language, name in (("fr", french), ("nl", dutch)) if name}


def points(coordinates: Iterable[list[float]]) -> list[Point]:
    """Positions of GeoJSON, longitude first, as points."""
    return [(round(latitude, DECIMALS), round(longitude, DECIMALS)) for longitude, latitude, *_ in coordinates]


def is_inside(line: list[Point]) -> bool:
    """Whether anything of it lies in the box or its margin."""
    (south, west), (north, east) = BOX
    return any(
        south - MARGIN <= latitude <= north + MARGIN and west - MARGIN <= longitude <= east + MARGIN
        for latitude, longitude in line
    )
