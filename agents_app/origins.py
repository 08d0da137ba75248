"""The origins of web pages (RFC 6454), as browsers write them in the header `Origin`."""

from __future__ import annotations

import re
from collections.abc import Iterable
from urllib.parse import urlsplit

from django.core.exceptions import ValidationError

HOST = re.compile(r"[a-z0-9]([a-z0-9.-]*[a-z0-9])?|\[[0-9a-f:.]+\]")
DEFAULT_PORTS = {"http": 80, "https": 443}


def read_origin(text: str) -> str:
    """`text` as a browser would write it, like https://example.org or http://localhost:5000. Raises ValidationError."""
    try:
        parts = urlsplit(text.strip().lower())
        port = parts.port
    except ValueError:
        raise _refusal(text) from None
    host = f"[{parts.hostname}]" if ":" in (parts.hostname or "") else parts.hostname or ""
    rest = (parts.path.rstrip("/"), parts.query, parts.fragment, parts.username)
    if parts.scheme not in DEFAULT_PORTS or not HOST.fullmatch(host) or any(rest):
        raise _refusal(text)
    return f"{parts.scheme}://{host}" + ("" if port in (None, DEFAULT_PORTS[parts.scheme]) else f":{port}")


def read_origins(texts: Iterable[str]) -> list[str]:
    """The origins, each once. Raises ValidationError."""
    return list(dict.fromkeys(read_origin(text) for text in texts))


def _refusal(text: str) -> ValidationError:
    return ValidationError(f"{text[:100]!r} is no origin: write e.g. https://example.org, without a path.")
