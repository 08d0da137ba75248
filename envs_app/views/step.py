"""POST /api/v1/step: the way of a step."""

from __future__ import annotations

from time import perf_counter

from django.http import HttpRequest, HttpResponse

from envs_app import openapi
from envs_app.errors import UnknownSession
from envs_app.handles import handles
from envs_app.metrics import observe_step
from envs_app.problems import refusal_of
from envs_app.renderers import json_response
from envs_app.requests import Caller, read_bearer, read_object
from envs_app.serializers import read_step, write_reply
from envs_app.sessions import step
from envs_app.steps import Reply, Step
from envs_app.views.slim import SlimView


def timed_step(session_key: str, what: Step, caller: Caller) -> Reply:
    """Step, and count it with what came of it."""
    started, code = perf_counter(), "ok"
    try:
        return step(session_key, what, caller)
    except Exception as error:
        code = refusal_of(error).code
        error.whereabouts = handles.whereabouts(session_key)  # type: ignore[attr-defined]  # for the log
        raise
    finally:
        observe_step(code, perf_counter() - started)


class StepView(SlimView):
    """Take a step."""

    @openapi.step
    def post(self, request: HttpRequest) -> HttpResponse:
        """Send what the environment shows, get the next action."""
        session_key = read_bearer(request)
        if session_key is None:
            raise UnknownSession("Send the session key as 'Authorization: Bearer <session key>'.")
        reply = timed_step(session_key, read_step(read_object(request)), Caller(request))
        return json_response(write_reply(reply))
