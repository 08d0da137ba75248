"""GET /healthz and /readyz: whether the process lives, and whether it can serve."""

from __future__ import annotations

from uuid import UUID

from django.db import connection
from django.http import HttpRequest, HttpResponse

from agents_app.fleet import get_fleet
from envs_app import openapi
from envs_app.renderers import json_response
from envs_app.views.slim import SlimView

NOBODY = str(UUID(int=0))


class HealthView(SlimView):
    """Alive."""

    @openapi.health
    def get(self, request: HttpRequest) -> HttpResponse:
        """This process answers. Asks nothing else, not even the database."""
        return json_response({"status": "ok"})


class ReadyView(SlimView):
    """Ready."""

    @openapi.ready
    def get(self, request: HttpRequest) -> HttpResponse:
        """The database and the executions can be reached; otherwise 503 `unavailable`."""
        with connection.cursor() as cursor:
            cursor.execute("SELECT 1")
        get_fleet().status(NOBODY)
        return json_response({"status": "ready"})
