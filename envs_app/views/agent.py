"""GET /api/v1/agent, /returns and /model: what the owner's programs read of an agent."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice
from typing import Any

from django.http import FileResponse, StreamingHttpResponse
from django.http.response import HttpResponseBase
from django.utils.text import slugify
from rest_framework.pagination import CursorPagination
from rest_framework.request import Request
from rest_framework.response import Response
from rest_framework.views import APIView

from agents_app import services
from agents_app.models import EpisodeReturn, Run
from envs_app import openapi
from envs_app.authentication import ApiKeyAuthentication, MayManage, api_key_of
from envs_app.errors import InvalidRequest, NotFound
from envs_app.serializers import AgentSerializer, EpisodeReturnSerializer

DIGITS = re.compile(r"[0-9]{1,18}")  # what every database takes


class ManageView(APIView):
    """What only keys with the scope `manage` may see."""

    authentication_classes = [ApiKeyAuthentication]
    permission_classes = [MayManage]


class AgentView(ManageView):
    """The agent."""

    @openapi.describe_agent
    def get(self, request: Request) -> Response:
        """The agent's configuration."""
        return Response(AgentSerializer(api_key_of(request).agent).data)


class ReturnsPages(CursorPagination):
    """Pages of episodes in the order in which they ended; a link stays right while episodes are added."""

    ordering = "id"
    page_size = 1000
    page_size_query_param = "limit"
    max_page_size = 10_000

    def decode_cursor(self, request: Request) -> Any:
        """The cursor of the query. DRF lets its position be any text; here it is the number of a row."""
        cursor = super().decode_cursor(request)
        if cursor is not None and not (cursor.position is None or DIGITS.fullmatch(str(cursor.position))):
            raise NotFound("The cursor is none that this list gave out; follow `next`.")
        return cursor


class ReturnsView(ManageView):
    """The learning curve."""

    @openapi.list_returns
    def get(self, request: Request) -> HttpResponseBase:
        """The returns of a run, page by page as JSON or whole as CSV."""
        run = _find_run(request)
        form = request.query_params.get("format", "json")
        if form == "csv":
            return _stream_csv(run)
        if form != "json":
            raise InvalidRequest("format is json or csv.")
        pages = ReturnsPages()
        returns = EpisodeReturn.objects.filter(run=run).select_related("run", "execution")
        page = pages.paginate_queryset(returns, request, view=self)
        return pages.get_paginated_response(EpisodeReturnSerializer(page, many=True).data)


class ModelView(ManageView):
    """The model."""

    @openapi.download_model
    def get(self, request: Request) -> FileResponse:
        """The newest model of a run, as a ZIP that stock Stable-Baselines3 loads."""
        run = _find_run(request)
        if (model := services.model_zip(run)) is None:
            raise NotFound(f"Run {run.number} has no save yet; the first one is made after some learning.")
        name = f"{slugify(run.agent.name) or 'agent'}-run-{run.number}.zip"
        return FileResponse(model, as_attachment=True, filename=name, content_type="application/zip")


def _find_run(request: Request) -> Run:
    """The run that the query names by its number; else the one that learns now."""
    agent = api_key_of(request).agent
    number = request.query_params.get("run")
    if number is None:
        return agent.current_run()
    if not DIGITS.fullmatch(number):
        raise InvalidRequest("run is the number of a run: 1, 2, ...")
    run = agent.runs.filter(number=int(number)).first()
    if run is None:
        raise NotFound(f"The agent has no run {number}.")
    return run


def _stream_csv(run: Run) -> StreamingHttpResponse:
    """All returns of the run, sent in pieces while they are read."""
    name = f"{slugify(run.agent.name) or 'agent'}-run-{run.number}-returns.csv"
    return StreamingHttpResponse(
        _join(services.returns_csv([run])),
        content_type="text/csv; charset=utf-8",
        headers={"Content-Disposition": f'attachment; filename="{name}"'},
    )


def _join(lines: Iterator[str]) -> Iterator[str]:
    """The lines by the thousand, as each piece that is sent has its price."""
    while piece := "".join(islice(lines, 1000)):
        yield piece
