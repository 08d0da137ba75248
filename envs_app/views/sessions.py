"""POST /api/v1/sessions and DELETE /api/v1/session: a conversation begins and ends."""

from __future__ import annotations

from django.http import HttpRequest, HttpResponse
from rest_framework.request import Request
from rest_framework.response import Response
from rest_framework.views import APIView

from envs_app import openapi
from envs_app.authentication import ApiKeyAuthentication, api_key_of
from envs_app.errors import InvalidRequest, UnknownSession
from envs_app.requests import Caller, read_bearer, read_object
from envs_app.serializers import SessionSerializer
from envs_app.sessions import close_session, open_session
from envs_app.throttles import count_login
from envs_app.views.slim import SlimView


class SessionsView(APIView):
    """Log in."""

    authentication_classes = [ApiKeyAuthentication]

    @openapi.open_session
    def post(self, request: Request) -> Response:
        """Open a session with the agent of the API key."""
        if request._request.body and read_object(request._request):
            raise InvalidRequest("A new session takes no body, or an empty object: {}.")
        api_key = api_key_of(request)
        count_login(api_key, Caller(request._request).network)
        session, session_key = open_session(api_key)
        reply = SessionSerializer({"session_key": session_key, "agent": session.agent})
        return Response(reply.data, status=201)


class SessionView(SlimView):
    """Log out."""

    @openapi.close_session
    def delete(self, request: HttpRequest) -> HttpResponse:
        """Close the session; its key opens nothing any more."""
        session_key = read_bearer(request)
        if session_key is None:
            raise UnknownSession("Send the session key as 'Authorization: Bearer <session key>'.")
        close_session(session_key)
        return HttpResponse(status=204)
