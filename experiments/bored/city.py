"""Simulated visitors of Brussels: hidden tastes, some shared by all and some their own (docs/bored.md has the contract).

A visitor comes for three visits within a week, of ten suggestions each. A suggestion is loved with the probability
sigmoid(BASE + quality of the place + taste of all for its type at this time and on this day + own taste for its type + own taste
for the place - own dislike of walking x kilometres).
"""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path

import numpy as np
from shepherd_environments.bored import BOX, CITY, TYPES, Place, Point, Visit, encode, is_open, not_lately, time_of_day

PLACES = Path(__file__).resolve().parents[2] / "frontend" / "bored" / "places.json"
BEGIN = datetime(2026, 6, 1, tzinfo=UTC)
VISITS, SUGGESTIONS = 3, 10  # of each visitor; in each visit
BASE = -1.8
KILOMETRES = np.array([111.2, 70.2])  # of a degree of latitude and longitude in Brussels


@cache
def read_places() -> list[Place]:
    """The actions, in their order."""
    rows = json.loads(PLACES.read_text(encoding="utf-8"))["places"]
    return [Place(row["type"], Point(row["lat"], row["lon"]), row.get("hours")) for row in rows]


@cache
def open_at(weekday: int, hour: int, minute: int) -> tuple[bool, ...]:
    """Which places are open at a minute of the week."""
    now = datetime(2026, 6, 1 + weekday, hour, minute, tzinfo=CITY)  # the first was a Monday
    return tuple(is_open(place.hours, now) for place in read_places())


@dataclass
class Visitor:
    """Somebody, and what the page remembers of them."""

    kinds: np.ndarray  # own taste for each type, (7,)
    likes: np.ndarray  # own taste for each place, (A,)
    laziness: float  # dislike of a kilometre
    here: Point
    before: Point | None = None
    type_before: str | None = None
    favourites: list[int] = field(default_factory=list)
    shown: dict[int, datetime] = field(default_factory=dict)
    loved: list[bool] = field(default_factory=list)
    chances: list[float] = field(default_factory=list)  # that each suggestion had of being loved


@dataclass
class Suggestion:
    """A moment at which a place is asked for."""

    visitor: int
    now: datetime
    observation: np.ndarray  # (29,) of float32
    allowed: np.ndarray  # (A,) of bool
    chances: np.ndarray  # (A,): how probable it is that each place would be loved; hidden from who suggests


class City:
    """Visitors arrive over some weeks; each one is always the same for the same seed, whatever is suggested to them."""

    def __init__(self, visitors: int, weeks: float, seed: int) -> None:
        self.places = read_places()
        rng = self._rng = np.random.default_rng(seed)
        self._types = np.array([TYPES.index(place.type) for place in self.places])
        self._at = np.array([place.at for place in self.places])
        self._quality = rng.normal(0.0, 0.6, len(self.places))
        self._by_time = rng.normal(0.0, 0.8, (4, len(TYPES)))
        self._by_day = rng.normal(0.0, 0.3, (7, len(TYPES)))
        self.visitors = [self._visitor() for _ in range(visitors)]
        self.moments = self._moments(visitors, weeks)

    def suggestion(self, moment: tuple[datetime, int]) -> Suggestion:
        """What is asked at a moment."""
        now, number = moment
        visitor = self.visitors[number]
        favourites = Counter(self.places[place].type for place in visitor.favourites)
        visit = Visit(now, visitor.here, visitor.before, visitor.type_before, favourites)
        mask = np.array(not_lately(list(self._open(now)), now, visitor.shown, visitor.favourites))
        return Suggestion(number, now, encode(visit), mask, self._chances(visitor, now))

    def answer(self, suggestion: Suggestion, place: int) -> float:
        """1 when the visitor loves the place, 0 when it is dismissed; they walk on."""
        visitor, at = self.visitors[suggestion.visitor], self.places[place].at
        loved = bool(self._rng.random() < suggestion.chances[place])
        visitor.loved.append(loved)
        visitor.chances.append(float(suggestion.chances[place]))
        visitor.shown[place] = suggestion.now
        visitor.before, visitor.type_before = visitor.here, self.places[place].type
        if loved:
            visitor.favourites.append(place)
        step = self._rng.normal(0.0, 0.1, 2) / KILOMETRES
        if loved and self._rng.random() < 0.3:
            step += np.subtract(at, visitor.here)
        visitor.here = Point(*np.add(visitor.here, step))
        return float(loved)

    def loved(self) -> np.ndarray:
        """(V, 30) of bool: by visitor in the order of their arrival, and by suggestion."""
        return np.array([visitor.loved for visitor in self.visitors])

    def chances(self) -> np.ndarray:
        """(V, 30): how probable it was that each would be; its mean is that of `loved`, with less noise."""
        return np.array([visitor.chances for visitor in self.visitors])

    def _open(self, now: datetime) -> tuple[bool, ...]:
        """Which places are open; a table, since at each suggestion all hours would be looked up anew."""
        local = now.astimezone(CITY)
        return open_at(local.weekday(), local.hour, local.minute)

    def _visitor(self) -> Visitor:
        rng = self._rng
        here = Point(*rng.uniform(*BOX))
        likes = rng.normal(0.0, 0.5, len(self.places))
        return Visitor(rng.normal(0.0, 1.2, len(TYPES)), likes, float(rng.lognormal(-0.3, 0.5)), here)

    def _moments(self, visitors: int, weeks: float) -> list[tuple[datetime, int]]:
        """All suggestions, in order; visitor 0 arrives first."""
        arrivals = np.sort(self._rng.uniform(0.0, 7.0 * weeks, visitors))
        moments = []
        for number, day in enumerate(arrivals):
            for later in (0, *np.sort(self._rng.choice(np.arange(1, 7), VISITS - 1, replace=False))):
                start = BEGIN + timedelta(days=int(day) + int(later), hours=float(self._rng.uniform(8, 22)))
                moments += [(start + timedelta(minutes=2 * count), number) for count in range(SUGGESTIONS)]
        return sorted(moments)

    def _chances(self, visitor: Visitor, now: datetime) -> np.ndarray:
        local = now.astimezone(CITY)
        shared = self._by_time[time_of_day(local.hour)] + self._by_day[local.weekday()]
        distance = np.linalg.norm((self._at - visitor.here) * KILOMETRES, axis=1)
        score = BASE + self._quality + (shared + visitor.kinds)[self._types] + visitor.likes
        return 1.0 / (1.0 + np.exp(visitor.laziness * distance - score))
