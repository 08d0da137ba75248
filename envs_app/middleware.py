"""The short way for programs: requests to the API skip what only pages for people need."""

from __future__ import annotations

from collections.abc import Callable

from django.http import HttpRequest, HttpResponse
from django.http.response import HttpResponseBase
from django.urls import resolve

from envs_app.problems import reply_to

API_PATHS = ("/api/", "/shepherd/", "/healthz", "/readyz", "/metrics")
PAGES = ("/api/docs/",)  # among them, for people


class ApiLane:
    """Calls the views of the API directly. Sessions, CSRF, messages and static files, which stand behind this in
    MIDDLEWARE, protect nothing here, as keys are sent in a header and never in a cookie, and would take 60 of the
    155 µs that Django takes for a step. What fails, an unknown address included, is answered in the API's own words.
    """

    def __init__(self, get_response: Callable[[HttpRequest], HttpResponseBase]) -> None:
        self.get_response = get_response

    def __call__(self, request: HttpRequest) -> HttpResponseBase:
        """The reply of the API, or of whatever else the request is for."""
        if not request.path_info.startswith(API_PATHS) or request.path_info.startswith(PAGES):
            return self.get_response(request)
        try:
            response = _call_view(request)
        except Exception as error:
            response = reply_to(error, request)
        if not response.streaming:
            response.headers.setdefault("Content-Length", str(len(response.content)))
        return response


def _call_view(request: HttpRequest) -> HttpResponse:
    match = request.resolver_match = resolve(request.path_info)
    response = match.func(request, *match.args, **match.kwargs)
    return response.render() if hasattr(response, "render") else response
