"""The Content-Security-Policy of every page: what a browser may load and run there, whatever has been smuggled in."""

from __future__ import annotations

import re
from typing import Any
from urllib.parse import urlsplit

from csp.constants import NONE, SELF, UNSAFE_EVAL, UNSAFE_INLINE
from csp.middleware import CSPMiddleware, PolicyParts
from django.conf import settings
from django.http import HttpRequest
from django.http.response import HttpResponseBase

Directives = dict[str, list[str]]

STRICT: Directives = {  # of all pages: files of this server, no inline script and no inline style
    "default-src": [SELF],
    "img-src": [SELF, "data:"],
    "object-src": [NONE],
    "base-uri": [NONE],
    "form-action": [SELF],
    "frame-ancestors": [NONE],
}
# django-unfold has style elements, and Alpine.js, which evaluates what stands in attributes of its templates.
ADMIN: Directives = {"script-src": [SELF, UNSAFE_EVAL], "style-src": [SELF, UNSAFE_INLINE]}
DOCS: Directives = {"style-src": [SELF, UNSAFE_INLINE]}  # Swagger UI


def bored() -> Directives:
    """The page of Bored in the city asks a server of map tiles and one of ways, as the settings say; empty: none."""
    tiles, routing = (source_of(url) for url in (settings.BORED_TILES, settings.BORED_ROUTING))
    return {"img-src": [SELF, "data:", "blob:", *tiles], "connect-src": [SELF, *routing]}


def source_of(url: str) -> list[str]:
    """The source of a policy that allows a URL, which may be a pattern like https://{s}.example.org/{z}/{x}/{y}.png."""
    parts = urlsplit(url)
    return [f"{parts.scheme}://{re.sub(r'{[^}]*}', '*', parts.netloc)}"] if parts.netloc else []


class PolicyMiddleware(CSPMiddleware):
    """Django-csp's, with what some pages need beyond STRICT."""

    def get_policy_parts(
        self, request: HttpRequest, response: HttpResponseBase, report_only: bool = False
    ) -> PolicyParts:
        """The policy of the page at the request's address."""
        parts = super().get_policy_parts(request, response, report_only)
        parts.replace = {**more_for(request.path_info), **(parts.replace or {})}
        return parts


def more_for(path: str) -> dict[str, Any]:
    """What the page at `path` may do beyond STRICT."""
    if path.startswith("/admin/"):
        return ADMIN
    if path.startswith("/api/docs/"):
        return DOCS
    return bored() if path.startswith("/bored/") else {}
