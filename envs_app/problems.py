"""What went wrong, as an HTTP reply: application/problem+json (RFC 9457), or the original protocol's {"ok": false}.

Every exception becomes one of envs_app.errors; nothing reaches the client as a traceback.
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil
from typing import Any

import orjson
import structlog
from django.core.exceptions import RequestDataTooBig, SuspiciousOperation
from django.db import InterfaceError, OperationalError
from django.http import Http404, HttpRequest, HttpResponse, UnreadablePostError
from rest_framework import exceptions

from envs_app.errors import (
    InternalError,
    InvalidRequest,
    MethodNotAllowed,
    NotFound,
    RequestTooLarge,
    ShepherdError,
    Unavailable,
)
from envs_app.transports.base import Away

log = structlog.get_logger("shepherd.http")

AWAY_WAIT = 0.25  # seconds, while what carries the steps is away: most often it is being started again
DEFAULT_WAIT = 1.0  # seconds, when an error that asks to wait does not say how long
UNREACHED = "The executions, or what they saved, cannot be reached now; repeat the request."
LEGACY_PATHS = "/shepherd/"


def reply_to(error: Exception, request: HttpRequest) -> HttpResponse:
    """The reply to a request that ended in `error`, in the words of the protocol that the address belongs to."""
    refusal = refusal_of(error)
    if refusal.status >= 500:
        _log(refusal, error, request)
    return (legacy_problem if request.path_info.startswith(LEGACY_PATHS) else problem)(refusal)


def exception_handler(error: Exception, context: dict[str, Any]) -> HttpResponse:
    """Django REST framework's hook: every exception of a view becomes a reply."""
    view, request = context["view"], context["request"]
    response = reply_to(error, getattr(request, "_request", request))
    if response.status_code == MethodNotAllowed.status:
        response["Allow"] = ", ".join(method for method in view.allowed_methods if method != "OPTIONS")
    return response


def refusal_of(error: Exception) -> ShepherdError:
    """The error of the API that an exception amounts to."""
    if isinstance(error, ShepherdError):
        return error
    for kinds, refuse in TRANSLATIONS:
        if isinstance(error, kinds):
            return refuse(error)
    return InternalError("Shepherd made an error; it is in the server's log. Nothing of this request was kept.")


TRANSLATIONS: tuple[tuple[Any, Callable[[Any], ShepherdError]], ...] = (
    (RequestDataTooBig, lambda error: RequestTooLarge(_too_large())),
    (UnreadablePostError, lambda error: InvalidRequest("The connection ended before the whole request had come.")),
    (
        (OperationalError, InterfaceError),
        lambda error: Unavailable("The database cannot be reached now; repeat the request."),
    ),
    (Away, lambda error: Unavailable(UNREACHED, AWAY_WAIT)),
    ((ConnectionError, TimeoutError, BlockingIOError), lambda error: Unavailable(UNREACHED)),
    ((Http404, exceptions.NotFound), lambda error: NotFound(_sentence(error, "There is nothing at this address."))),
    (exceptions.MethodNotAllowed, lambda error: MethodNotAllowed(str(error.detail))),
    (
        SuspiciousOperation,
        lambda error: InvalidRequest(f"The request is not taken: {error}"),
    ),  # e.g. a foreign host name
    (exceptions.APIException, lambda error: InvalidRequest(str(error.detail))),
)


def problem(error: ShepherdError) -> HttpResponse:
    """The error as a problem document."""
    return _response(error, describe(error), "application/problem+json")


def describe(error: ShepherdError) -> dict[str, Any]:
    """What a problem document says. `retry_after` has fractions; the header, by its standard, whole seconds."""
    body: dict[str, Any] = {
        "type": f"urn:shepherd:problem:{error.code}",
        "title": error.title,
        "status": error.status,
        "detail": error.detail,
        "code": error.code,
    }
    if _is_temporary(error):
        body["retry_after"] = _wait(error)
    return body


def legacy_problem(error: ShepherdError) -> HttpResponse:
    """The error in the words of the original protocol."""
    return _response(error, {"ok": False, "error": error.detail}, "application/json")


def _response(error: ShepherdError, body: dict[str, Any], content_type: str) -> HttpResponse:
    response = HttpResponse(orjson.dumps(body), content_type=content_type, status=error.status)
    if _is_temporary(error):
        response["Retry-After"] = str(max(1, ceil(_wait(error))))
    if error.status == 401:
        response["WWW-Authenticate"] = 'Bearer realm="Shepherd"'
    response._has_been_logged = True  # type: ignore[attr-defined]  # else Django logs each as a warning
    return response


def _is_temporary(error: ShepherdError) -> bool:
    return error.status in (429, 503)


def _wait(error: ShepherdError) -> float:
    """Seconds, rounded up to milliseconds."""
    return DEFAULT_WAIT if error.retry_after is None else ceil(max(0.0, error.retry_after) * 1000) / 1000


def _too_large() -> str:
    from django.conf import settings

    return f"The body is larger than {settings.MAX_BODY_BYTES} bytes, the most that is taken; send less at once."


def _sentence(error: Exception, default: str) -> str:
    detail = str(getattr(error, "detail", ""))
    return detail or default


def _log(refusal: ShepherdError, error: Exception, request: HttpRequest) -> None:
    """A fault of Shepherd with its traceback; a refusal for lack of room or a lost connection in one line."""
    facts = {"code": refusal.code, "method": request.method, "path": request.path_info}
    facts |= getattr(error, "whereabouts", {})  # of the session, where there is one
    if isinstance(refusal, InternalError):
        log.error("request failed", exc_info=error, **facts)
    else:
        log.warning("request refused", reason=refusal.detail, cause=type(error).__name__, **facts)
