"""GET /metrics: for Prometheus."""

from __future__ import annotations

from django.conf import settings
from django.http import HttpRequest, HttpResponse
from django.utils.crypto import constant_time_compare

from envs_app import metrics, openapi
from envs_app.errors import InvalidApiKey
from envs_app.requests import read_bearer
from envs_app.views.slim import SlimView


class MetricsView(SlimView):
    """Metrics."""

    @openapi.metrics
    def get(self, request: HttpRequest) -> HttpResponse:
        """Steps by outcome and duration, open sessions, live executions, in Prometheus' text format."""
        wanted, sent = settings.METRICS_KEY, read_bearer(request) or ""
        if wanted and not constant_time_compare(sent, wanted):
            raise InvalidApiKey("Metrics need 'Authorization: Bearer' with the value of SHEPHERD_METRICS_KEY.")
        return HttpResponse(metrics.render(), content_type=metrics.CONTENT_TYPE)
