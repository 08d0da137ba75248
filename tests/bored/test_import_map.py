"""`manage.py import_map`: the street map that an operator makes for Bored in the city."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from django.core.management import CommandError, call_command
from django.test import Client

from frontend.street_map import convert

SHARED = Path(__file__).parents[3] / "shared" / "reference" / "places"  # beside a developer's clone, if at all
STREET = [[4.3500, 50.8470], [4.3523456, 50.8480123]]
RING = [[4.36, 50.844], [4.363, 50.846], [4.365, 50.844], [4.36, 50.844]]
ELSEWHERE = [[3.72, 51.05], [3.73, 51.06]]


def feature(shape: str, coordinates: list, **tags: str) -> dict:
    """A feature of GeoJSON."""
    return {"type": "Feature", "properties": tags, "geometry": {"type": shape, "coordinates": coordinates}}


EXTRACT = [
    feature("LineString", STREET, highway="secondary", name="Rue Neuve - Nieuwstraat", **{"name:fr": "Rue Neuve"}),
    feature("MultiLineString", [STREET, ELSEWHERE], highway="footway"),
    feature("LineString", STREET, kind="minor", name="Rue du Midi", name_nl="Zuidstraat"),
    feature("LineString", STREET, waterway="stream"),
    feature("LineString", ELSEWHERE, highway="primary"),
    feature("Polygon", [RING, RING], leisure="park", name="Parc", **{"name:nl": "Park"}),
    feature("MultiPolygon", [[RING]], building="yes"),
    feature("Polygon", [RING], highway="pedestrian"),
    feature("Polygon", [RING], amenity="parking"),
    feature("Point", [4.3527, 50.8507, 12.0], station="subway", name="De Brouckère"),
    feature("Point", [4.3527, 50.8507], amenity="bench"),
    {"type": "Feature", "properties": None, "geometry": None},
]


def write(folder: Path, features: list) -> Path:
    """A file with these features."""
    file = folder / "extract.geojson"
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return file


def test_what_can_be_drawn_is_kept_and_the_rest_is_not():
    found = convert(EXTRACT, "© somebody")
    assert [street["kind"] for street in found["streets"]] == ["main", "foot", "street"]
    assert found["streets"][0] == {"fr": "Rue Neuve", "kind": "main", "line": [(50.847, 4.35), (50.84801, 4.35235)]}
    assert (found["streets"][2]["fr"], found["streets"][2]["nl"]) == ("Rue du Midi", "Zuidstraat")
    assert [area["kind"] for area in found["areas"]] == ["park", "building", "square"]
    assert found["areas"][0]["ring"][1] == (50.846, 4.363)
    assert found["stations"] == [{"fr": "De Brouckère", "at": (50.8507, 4.3527)}]
    assert found["attribution"] == "© somebody"


@pytest.mark.django_db
def test_the_page_draws_the_imported_map_as_soon_as_it_is_there(tmp_path):
    assert Client().get("/bored/config.json").json()["map"] == "sketch.json"
    assert Client().get("/bored/map.json").status_code == 404
    out = io.StringIO()
    call_command("import_map", str(write(tmp_path, EXTRACT)), stdout=out)
    assert out.getvalue().startswith("3 streets, 3 areas, 1 stations")
    assert Client().get("/bored/config.json").json()["map"] == "map.json"
    served = json.loads(b"".join(Client().get("/bored/map.json").streaming_content))
    assert served["attribution"] == "© OpenStreetMap contributors"
    assert len(served["streets"]) == 3


def test_what_is_no_extract_of_the_city_is_refused_and_nothing_is_written(tmp_path):
    target = tmp_path / "map.json"
    (tmp_path / "text.geojson").write_text("[]")
    for extract, sentence in [
        (write(tmp_path, [feature("LineString", ELSEWHERE, highway="primary")]), "no street"),
        (tmp_path / "text.geojson", "no GeoJSON"),
        (tmp_path / "nothing", "no GeoJSON"),
    ]:
        with pytest.raises(CommandError, match=sentence):
            call_command("import_map", str(extract), output=target)
    assert not target.exists()


@pytest.mark.skipif(not SHARED.is_dir(), reason="the extract of OpenStreetMap is not beside this clone")
def test_a_real_extract_of_openstreetmap_becomes_a_map(tmp_path):
    files = [str(SHARED / f"brussels_{what}.geojson") for what in ("streets", "areas")]
    target = tmp_path / "map.json"
    call_command("import_map", *files, output=target, stdout=io.StringIO())
    found = json.loads(target.read_text(encoding="utf-8"))
    assert len(found["streets"]) > 1000
    assert {"Grand-Place", "Rue Neuve"} <= {street.get("fr") for street in found["streets"] + found["areas"]}
    assert len(found["stations"]) >= 6
    assert target.stat().st_size < 600_000
