"""Bored in the city, served: the files of frontend/bored/ as they are, and what is set for this server."""

from __future__ import annotations

from pathlib import Path

from django.conf import settings
from django.http import Http404, HttpRequest, JsonResponse
from django.http.response import HttpResponseBase
from django.urls import reverse
from django.views.decorators.gzip import gzip_page
from django.views.decorators.http import require_safe

from agents_app.models import Agent, APIKey, hash_key
from frontend.files import revalidated, serve_file, serve_part

AGENT = "Bored in the city"
FOLDER = Path(__file__).resolve().parent / "bored"
PUBLIC = {"css", "icons", "js", "lang", "vendor"}  # folders; beside them, the files at the top that are no tools
TOOLS = {"package.json", "package-lock.json", "tsconfig.json", "README.md"}


@require_safe
@gzip_page
def page(request: HttpRequest, file: str = "index.html") -> HttpResponseBase:
    """A file of the page. Browsers ask each time whether it has changed, so that all files are of one version."""
    if "/" in file:
        return serve_part(request, FOLDER, file, PUBLIC)
    if file in TOOLS or file.startswith("."):
        raise Http404
    return serve_file(request, FOLDER, file)


@require_safe
def config(request: HttpRequest) -> HttpResponseBase:
    """What the page needs to know (js/config.js says what it means)."""
    key = settings.BORED_KEY or _published_key()
    told = {
        "key": key,
        "live": _live_page_of(key),
        "tiles": {"url": settings.BORED_TILES, "attribution": settings.BORED_ATTRIBUTION}
        if settings.BORED_TILES
        else None,
        "routing": settings.BORED_ROUTING or None,
        "map": "map.json" if map_file().exists() else "sketch.json",
        "sessionDays": settings.SESSION_DAYS,
    }
    return revalidated(JsonResponse(told))


@require_safe
@gzip_page
def street_map(request: HttpRequest) -> HttpResponseBase:
    """The streets that the operator has imported (`manage.py import_map`)."""
    return serve_file(request, map_file().parent, map_file().name)


def map_file() -> Path:
    """Where the imported streets are kept."""
    return settings.DATA_DIR / "bored" / "map.json"


def _published_key() -> str | None:
    """The publishable key of the newest agent that is called AGENT."""
    agents = Agent.objects.filter(name=AGENT).order_by("-created_at")
    return next((key for agent in agents if (key := APIKey.published_for(agent))), None)


def _live_page_of(key: str | None) -> str | None:
    """The address of the live page of the key's agent, if everybody may see it."""
    agent = Agent.objects.filter(api_keys__hash=hash_key(key or ""), public=True).first()
    return reverse("agent", args=[agent.pk]) if agent else None
