"""The original protocol, exactly as clients in the field speak it: /shepherd/login_user/ and /shepherd/env/."""

from __future__ import annotations

from django.http import HttpRequest, HttpResponse

from envs_app import openapi
from envs_app.authentication import find_api_key
from envs_app.renderers import json_response
from envs_app.requests import Caller, read_object
from envs_app.serializers import read_legacy_step, read_text
from envs_app.sessions import close_session, open_session
from envs_app.throttles import count_login
from envs_app.views.slim import SlimView
from envs_app.views.step import timed_step


class LoginView(SlimView):
    """Log in, in the original protocol."""

    @openapi.legacy_login
    def post(self, request: HttpRequest) -> HttpResponse:
        """Open a session with the agent of the API key."""
        caller = Caller(request)
        api_key = find_api_key(read_text(read_object(request), "apikey"), caller)
        count_login(api_key, caller.network)
        _, session_key = open_session(api_key)
        return json_response({"ok": True, "session_key": session_key})


class EnvView(SlimView):
    """Take a step, in the original protocol."""

    @openapi.legacy_step
    def post(self, request: HttpRequest) -> HttpResponse:
        """Get the next action; null after `done`. An `obs` of null closes the session."""
        body = read_object(request)
        session_key = read_text(body, "session_key")
        step = read_legacy_step(body)
        if step.obs is None:
            close_session(session_key)
            return json_response({"action": None})
        return json_response({"action": timed_step(session_key, step, Caller(request)).action})
