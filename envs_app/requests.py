"""Reading a request: who asks, its bearer key, and its JSON body, whatever content type it claims."""

from __future__ import annotations

import json
from ipaddress import IPv6Address, IPv6Network
from typing import Any

import orjson
from django.http import HttpRequest

from envs_app.errors import InvalidRequest


def read_bearer(request: HttpRequest) -> str | None:
    """The key of the header `Authorization: Bearer KEY`; None when there is none."""
    scheme, _, key = request.META.get("HTTP_AUTHORIZATION", "").partition(" ")
    return key.strip() or None if scheme.lower() == "bearer" else None


def read_object(request: HttpRequest) -> dict[str, Any]:
    """The body, a JSON object. Raises InvalidRequest, or RequestDataTooBig past settings.MAX_BODY_BYTES."""
    body = request.body
    try:
        value = orjson.loads(body)
    except orjson.JSONDecodeError as error:
        value = _read_lenient(request, body, error)
    if type(value) is not dict:
        raise InvalidRequest("The body must be a JSON object, such as {...}.")
    return value


class Caller:
    """Who asks, read from a request only when it is asked for: most keys do not want to know."""

    __slots__ = ("_request",)

    def __init__(self, request: HttpRequest) -> None:
        self._request = request

    @property
    def origin(self) -> str:
        """The origin of the page that asks, as its browser says; '' when no browser does."""
        return self._request.META.get("HTTP_ORIGIN", "").lower()

    @property
    def host(self) -> str:
        """The host and port by which this server was asked."""
        return self._request.get_host().lower()

    @property
    def network(self) -> str:
        """Whom a throttle counts: the network address, or of IPv6 the /64, within which a client may choose."""
        address = address_of(self._request)
        return _prefix_of(address) if ":" in address else address


def address_of(request: HttpRequest) -> str:
    """The client's network address, as the server or the proxy that ends TLS saw it."""
    from django.conf import settings

    forwarded = request.META.get("HTTP_X_FORWARDED_FOR", "") if settings.BEHIND_TLS else ""
    return forwarded.rpartition(",")[2].strip() or request.META.get("REMOTE_ADDR", "")


def _prefix_of(address: str) -> str:
    try:
        full = IPv6Address(address)
    except ValueError:
        return address
    return str(full.ipv4_mapped or IPv6Network((int(full) >> 64 << 64, 64)))


def _read_lenient(request: HttpRequest, body: bytes, error: orjson.JSONDecodeError) -> Any:
    """A body that is no JSON. Many encoders write NaN and Infinity, which JSON has not: these are let through, so that
    the check of the observation or reward can say where they are. Raises InvalidRequest for anything else."""
    if not body:
        chunked = request.META.get("HTTP_TRANSFER_ENCODING")
        wanted = "send it with a Content-Length" if chunked else "send a JSON object"
        raise InvalidRequest(f"The body is empty: {wanted}.")
    if b"NaN" in body or b"Infinity" in body:
        try:
            value = json.loads(body)
            orjson.dumps(value)  # refuses half surrogates and numbers past 64 bits, as orjson.loads does
            return value
        except (ValueError, TypeError, RecursionError):
            pass
    raise InvalidRequest(f"The body is not valid JSON: {error}.")
