"""Replies as JSON, by orjson."""

from __future__ import annotations

from typing import Any

import orjson
from django.http import HttpResponse
from rest_framework.negotiation import BaseContentNegotiation
from rest_framework.renderers import BaseRenderer
from rest_framework.request import Request


def json_response(data: Any, status: int = 200) -> HttpResponse:
    """The data as a JSON reply."""
    return HttpResponse(orjson.dumps(data), content_type="application/json", status=status)


class OrjsonRenderer(BaseRenderer):
    """The replies of Django REST framework."""

    media_type = "application/json"
    format = "json"
    charset = None

    def render(self, data: Any, accepted_media_type: str | None = None, renderer_context: Any = None) -> bytes:
        """The data as JSON."""
        return orjson.dumps(data)


class OneForm(BaseContentNegotiation):
    """Every endpoint has one form of reply, whatever a client says that it accepts."""

    def select_parser(self, request: Request, parsers: Any) -> Any:
        """The only one."""
        return parsers[0]

    def select_renderer(self, request: Request, renderers: Any, format_suffix: str | None = None) -> Any:
        """The first one."""
        return renderers[0], renderers[0].media_type
