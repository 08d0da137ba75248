"""Bored in the city (thesis 5.5.3): what its agent observes, and which places may be suggested now.

The contract between the page and the agent, in words in docs/bored.md of Shepherd's repository. The page does the same in
JavaScript; both are tested against the same vectors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import NamedTuple
from zoneinfo import ZoneInfo

import numpy as np

TYPES = ("restaurant", "asian_restaurant", "shop", "thriftshop", "cafe", "bar", "sightseeing")
BOX = ((50.840, 4.338), (50.857, 4.366))  # south-west and north-east corner, latitude and longitude
CITY = ZoneInfo("Europe/Brussels")
DAY_BEGINS = (6, 12, 18, 23)  # hours at which morning, afternoon, evening and night begin
OBSERVATION = 4 + 7 + 7 + 4 + 7  # numbers
LATELY = timedelta(days=7)
FEWEST = 10  # places to choose from, while there are so many that may come back
MIDNIGHT = 24 * 60  # minutes

Hours = Sequence[Sequence[tuple[int, int]]]


class Point(NamedTuple):
    """Where somebody or something is, in degrees."""

    lat: float
    lon: float


@dataclass(frozen=True)
class Place:
    """What may be suggested: an action of the agent."""

    type: str  # one of TYPES
    at: Point
    hours: Hours | None = None  # per weekday from Monday, minutes from midnight [opens, closes); None: unknown


@dataclass
class Visit:
    """What is known of a visitor when a place is to be suggested."""

    now: datetime  # of any time zone
    here: Point
    before: Point | None = None  # where they were at the suggestion before; None: there was none
    type_before: str | None = None  # of the place suggested before
    favourites: Mapping[str, int] = field(default_factory=dict)  # how many, by type


def encode(visit: Visit) -> np.ndarray:
    """The observation, (29,) of float32, each from -1 to 1: docs/bored.md says which number means what."""
    local = visit.now.astimezone(CITY)
    parts = [
        in_box(visit.here),
        in_box(visit.before or visit.here),
        [float(kind == visit.type_before) for kind in TYPES],
        shares(visit.favourites),
        one_hot(time_of_day(local.hour), len(DAY_BEGINS)),
        one_hot(local.weekday(), 7),
    ]
    return np.array([number for part in parts for number in part], np.float32)


def features(places: Sequence[Place]) -> list[list[float]]:
    """What the agent knows of its actions, 10 numbers each: type, one-hot; where it is in the box, y and x, and y^2 + x^2.

    With the squares, a sum of products with the observation can be the squared distance from the visitor.
    """
    rows = []
    for place in places:
        y, x = in_box(place.at)
        rows.append([*one_hot(TYPES.index(place.type), len(TYPES)), y, x, y * y + x * x])
    return rows


def in_box(point: Point) -> list[float]:
    """Latitude and longitude from -1 to 1 across the box; whoever is outside is at its edge."""
    return [
        min(1.0, max(-1.0, 2.0 * (value - low) / (high - low) - 1.0))
        for value, low, high in zip(point, *BOX, strict=True)
    ]


def shares(favourites: Mapping[str, int]) -> list[float]:
    """Of each type among the favourites; all 0 without favourites."""
    total = sum(favourites.values())
    return [favourites.get(kind, 0) / total if total else 0.0 for kind in TYPES]


def time_of_day(hour: int) -> int:
    """0 morning, 1 afternoon, 2 evening, 3 night, which lasts until the morning."""
    return (sum(hour >= begins for begins in DAY_BEGINS) - 1) % len(DAY_BEGINS)


def one_hot(index: int, length: int) -> list[float]:
    """A 1 among zeros."""
    return [float(place == index) for place in range(length)]


def is_open(hours: Hours | None, now: datetime) -> bool:
    """Whether a place is open; one with unknown hours is. Hours past midnight belong to the day on which they began."""
    if hours is None:
        return True
    local = now.astimezone(CITY)
    minute, today = 60 * local.hour + local.minute, local.weekday()
    yesterday = [(opens - MIDNIGHT, closes - MIDNIGHT) for opens, closes in hours[today - 1]]
    return any(opens <= minute < closes for opens, closes in [*hours[today], *yesterday])


def allowed(
    places: Sequence[Place], now: datetime, shown: Mapping[int, datetime], favourites: Sequence[int] = ()
) -> list[bool]:
    """Which places may be suggested now: `shown` says when each was last suggested to this visitor.

    Not those that are closed, are favourites already, or were shown within LATELY. Where fewer than FEWEST remain, what was
    shown longest ago comes back; where none remains, all are allowed.
    """
    return not_lately([is_open(place.hours, now) for place in places], now, shown, favourites)


def not_lately(
    offered: list[bool], now: datetime, shown: Mapping[int, datetime], favourites: Sequence[int] = ()
) -> list[bool]:
    """`allowed`, where it is known which places are open. Changes `offered`."""
    for index in favourites:
        offered[index] = False
    lately = {index: at for index, at in shown.items() if offered[index] and now - at < LATELY}
    mask = [offer and index not in lately for index, offer in enumerate(offered)]
    for index in sorted(lately, key=lambda index: (lately[index], index))[: max(0, FEWEST - sum(mask))]:
        mask[index] = True
    return mask if any(mask) else [True] * len(offered)
