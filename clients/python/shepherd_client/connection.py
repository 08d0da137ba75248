"""One HTTP connection that is kept alive, and opened again when it was lost."""

from __future__ import annotations

import http.client
import ssl
from dataclasses import dataclass
from http.client import HTTPMessage
from typing import Any
from urllib.parse import urlsplit

from shepherd_client import errors
from shepherd_client.encoding import decode, encode

Answer = tuple[int, HTTPMessage, bytes]  # status, headers, body


@dataclass(frozen=True)
class Address:
    """Where a Shepherd server is, e.g. http://127.0.0.1:8000."""

    scheme: str
    host: str
    port: int | None
    path: str

    @classmethod
    def parse(cls, url: str) -> Address:
        """The address of a URL. Raises ValueError if it is none."""
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ValueError(f"{url!r} is no URL of a Shepherd server: write e.g. http://127.0.0.1:8000.")
        return cls(parts.scheme, parts.hostname, parts.port, parts.path.rstrip("/"))

    def __str__(self) -> str:
        return f"{self.scheme}://{self.host}{f':{self.port}' if self.port else ''}{self.path}"


class Connection:
    """Sends requests one after the other. http.client sets TCP_NODELAY, so that small packets do not wait."""

    def __init__(self, address: Address, timeout: float) -> None:
        self.address = address
        https = address.scheme == "https"
        kind = http.client.HTTPSConnection if https else http.client.HTTPConnection
        self._http = kind(address.host, address.port, timeout=timeout)

    def request(self, method: str, path: str, key: str, payload: Any = None) -> dict[str, Any]:
        """The reply's JSON object. Raises a ShepherdError for every other answer, and for none."""
        status, headers, body = self._answer(method, path, key, None if payload is None else encode(payload))
        if status == 204:
            return {}
        reply = _decode_object(body)
        if reply is not None and 200 <= status < 300:
            return reply
        raise _error_of(status, headers, reply or {}, self.address)

    def close(self) -> None:
        """Close the connection; the next request opens it again."""
        self._http.close()

    def _answer(self, method: str, path: str, key: str, body: bytes | None) -> Answer:
        try:
            return self._exchange(method, path, key, body)
        except ssl.SSLCertVerificationError as error:
            raise errors.UnexpectedReply(f"{self.address} has no certificate to trust: {error.verify_message}.")
        except (OSError, http.client.HTTPException) as error:
            reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
            raise errors.ConnectionLost(f"No answer from {self.address}: {reason}.")

    def _exchange(self, method: str, path: str, key: str, body: bytes | None) -> Answer:
        headers = {"Authorization": f"Bearer {key}"}
        if body is not None:
            headers["Content-Type"] = "application/json"
        try:
            self._http.request(method, self.address.path + path, body, headers)
            response = self._http.getresponse()
            return response.status, response.headers, response.read()
        except BaseException:  # Ctrl-C too: half an answer must not be taken for the next one
            self._http.close()
            raise


def _decode_object(body: bytes) -> dict[str, Any] | None:
    try:
        reply = decode(body)
    except ValueError:
        return None
    return reply if isinstance(reply, dict) else None


def _error_of(status: int, headers: HTTPMessage, problem: dict[str, Any], address: Address) -> errors.ShepherdError:
    """The typed error of an answer that is no success (RFC 9457), by its code, else by its status."""
    code = str(problem.get("code", ""))
    kind = errors.BY_CODE.get(code) or errors.BY_STATUS.get(status)
    if kind is None:
        kind = errors.ShepherdError if code else errors.UnexpectedReply
    detail = problem.get("detail") or f"{address} answered {status}, which is no answer of Shepherd: is the URL right?"
    wait = problem.get("retry_after", headers.get("Retry-After"))  # the header has whole seconds only
    return kind(str(detail), code=code, status=status, retry_after=_seconds(wait))


def _seconds(value: Any) -> float | None:
    """Seconds as the server wrote them; a date is not understood."""
    try:
        return None if value is None else max(0.0, float(value))
    except (TypeError, ValueError):
        return None
