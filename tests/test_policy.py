"""Every page has a Content-Security-Policy."""

import pytest
from django.test import Client

from shepherd.csp import source_of


def policy(path: str) -> dict[str, list[str]]:
    header = Client().get(path)["Content-Security-Policy"]
    return {words[0]: words[1:] for words in (part.split() for part in header.split(";"))}


@pytest.mark.django_db
@pytest.mark.parametrize(
    "path", ["/admin/login/", "/admin/", "/api/docs/", "/bored/", "/nothing", "/", "/static/nothing.js"]
)
def test_every_page_has_one(path):
    found = policy(path)
    assert found["default-src"] == ["'self'"]
    assert found["frame-ancestors"] == found["object-src"] == found["base-uri"] == ["'none'"]
    assert "'unsafe-inline'" not in found.get("script-src", [])


@pytest.mark.django_db
def test_only_the_admin_evaluates_strings():
    assert "'unsafe-eval'" in policy("/admin/login/")["script-src"]
    assert not any("unsafe" in word for words in policy("/nothing").values() for word in words)


@pytest.mark.django_db
def test_bored_asks_the_servers_that_the_settings_name(settings):
    settings.BORED_TILES, settings.BORED_ROUTING = (
        "https://{s}.tile.example/{z}/{x}/{y}.png",
        "http://ways.example:5000/foot",
    )
    found = policy("/bored/")
    assert found["img-src"] == ["'self'", "data:", "blob:", "https://*.tile.example"]
    assert found["connect-src"] == ["'self'", "http://ways.example:5000"]
    settings.BORED_TILES = settings.BORED_ROUTING = ""
    assert policy("/bored/")["connect-src"] == ["'self'"]


@pytest.mark.parametrize(
    ("url", "source"), [("", []), ("/tiles/{z}", []), ("https://a.example/x", ["https://a.example"])]
)
def test_sources_are_hosts(url, source):
    assert source_of(url) == source
