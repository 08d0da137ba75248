"""Bored in the city: page and agent agree on what is sent (docs/bored.md); the page's tests read the same vectors."""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shepherd_environments.bored import OBSERVATION, Place, Point, Visit, allowed, encode

VECTORS = json.loads((Path(__file__).parent / "vectors.json").read_text(encoding="utf-8"))
PLACES = [Place(place["type"], Point(place["lat"], place["lon"]), place["hours"]) for place in VECTORS["places"]]


def by_name(case: dict[str, Any]) -> str:
    """For the test's own name."""
    return case["name"]


@pytest.mark.parametrize("case", VECTORS["observations"], ids=by_name)
def test_observations_are_encoded_as_agreed(case: dict[str, Any]) -> None:
    before = Point(*case["before"]) if case["before"] else None
    visit = Visit(
        datetime.fromisoformat(case["now"]), Point(*case["here"]), before, case["type_before"], case["favourites"]
    )
    observation = encode(visit)
    assert observation.shape == (OBSERVATION,)
    assert observation.dtype == np.float32
    np.testing.assert_allclose(observation, case["observation"], atol=1e-5)


@pytest.mark.parametrize("case", VECTORS["masks"], ids=by_name)
def test_places_are_masked_as_agreed(case: dict[str, Any]) -> None:
    shown = {int(index): datetime.fromisoformat(at) for index, at in case["shown"].items()}
    assert allowed(PLACES, datetime.fromisoformat(case["now"]), shown, case["favourites"]) == case["mask"]
