"""The OpenAPI schema: current, complete, and shown without foreign hosts."""

import re
from pathlib import Path

import pytest
import yaml
from drf_spectacular.generators import SchemaGenerator
from drf_spectacular.validation import validate_schema

from envs_app.urls import urlpatterns

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def schema():
    return SchemaGenerator().get_schema(request=None, public=True)


def test_the_committed_schema_is_current(schema):
    committed = yaml.safe_load((DOCS / "openapi.yaml").read_text())
    assert committed == schema, "run: manage.py spectacular --validate --file docs/openapi.yaml"


def test_it_is_valid_openapi_3_1(schema):
    assert schema["openapi"].startswith("3.1")
    validate_schema(schema)


def test_it_has_every_address(schema):
    routes = {"/" + re.sub(r"[\^?$]", "", str(pattern.pattern)) for pattern in urlpatterns}
    assert routes - {"/api/schema/", "/api/docs/"} == set(schema["paths"])


def operations(schema):
    return [operation for path in schema["paths"].values() for operation in path.values()]


def test_everything_that_takes_a_key_says_which_one(schema):
    for operation in operations(schema):
        expected = operation["tags"][0] in ("session", "agent")
        assert ("security" in operation and bool(operation["security"])) == expected, operation["operationId"]


def test_every_operation_tells_its_refusals_with_examples(schema):
    for operation in operations(schema):
        assert {"405", "503", "500"} <= operation["responses"].keys(), operation["operationId"]
        for status, response in operation["responses"].items():
            if status >= "400":
                (content,) = response["content"].values()
                assert content["examples"], (operation["operationId"], status)


def test_the_page_is_served_without_foreign_hosts(api):
    page = api.get("/api/docs/").content.decode()
    sources = re.findall(r'(?:src|href)="([^"]+)"', page)
    assert sources
    for source in sources:
        assert source.startswith("/"), source
        assert api.get(source).status_code == 200, source


def test_the_schema_is_served(api, schema):
    assert yaml.safe_load(api.get("/api/schema/").content) == schema
