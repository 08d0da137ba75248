"""Pages that are files, served as they are."""

from __future__ import annotations

from pathlib import Path

from django.http import Http404, HttpRequest
from django.http.response import HttpResponseBase
from django.views.static import serve


def serve_file(request: HttpRequest, home: Path, file: str) -> HttpResponseBase:
    """A file below `home`. Browsers ask each time whether it has changed, so that all files are of one version.

    Raises Http404.
    """
    return revalidated(serve(request, file, document_root=str(home)))


def serve_part(request: HttpRequest, home: Path, file: str, public: set[str]) -> HttpResponseBase:
    """The same, if it is in one of the public folders. Raises Http404."""
    folder, *rest = file.split("/")
    if not rest or folder not in public or ".." in rest:
        raise Http404
    return serve_file(request, home, file)


def revalidated(response: HttpResponseBase) -> HttpResponseBase:
    """The response, which may be kept and is asked about before it is used again."""
    response.headers["Cache-Control"] = "no-cache"
    return response
