"""GET /metrics: for Prometheus."""

from __future__ import annotations

from django.http import HttpRequest, HttpResponse

from envs_app import metrics, openapi
from envs_app.views.slim import SlimView


class MetricsView(SlimView):
    """Metrics."""

    @openapi.metrics
    def get(self, request: HttpRequest) -> HttpResponse:
        """Steps by outcome and duration, open sessions, live executions, in Prometheus' text format."""
        return HttpResponse(metrics.render(), content_type=metrics.CONTENT_TYPE)
