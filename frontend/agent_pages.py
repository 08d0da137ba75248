"""The live page of an agent, and what it asks for every few seconds: for owners, and for everybody if the owner says so.

It tells nothing of keys, errors, sessions, the owner or the owner's other agents. Whoever may not see an agent cannot tell
whether there is one.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache, wraps
from pathlib import Path
from typing import Any
from uuid import UUID

from django.http import Http404, HttpRequest, HttpResponse, JsonResponse
from django.http.response import HttpResponseBase
from django.shortcuts import render
from django.views.decorators.cache import never_cache
from django.views.decorators.gzip import gzip_page
from django.views.decorators.http import require_safe

from agents_app import live, tallies
from agents_app.fleet import ExecutionStatus
from agents_app.models import Agent
from frontend import bored_pages
from frontend.files import serve_part
from frontend.sharing import Recent

FOLDER = Path(__file__).resolve().parent / "agents"
PUBLIC = {"css", "js"}
TOLD = ("number", "state", "sessions", "episodes", "steps", "steps_per_second", "updates", "mean_return", "advises")
ASKED = ("run", "by", "version")
SOMEBODY = "another agent"  # what a frozen advisor is called before those who may not know its name
OBSERVATION_OF_BORED = [[29], -1, 1]  # docs/bored.md

View = Callable[..., HttpResponse]


def shown(view: View) -> Callable[..., HttpResponseBase]:
    """For GET, with the agent in place of its id, if the person may see it; no cache keeps the answer."""

    @require_safe
    @never_cache
    @gzip_page
    @wraps(view)
    def guarded(request: HttpRequest, agent_id: UUID) -> HttpResponse:
        agent = Agent.objects.select_related("algorithm").filter(pk=agent_id).first()
        if agent is None or not (agent.public or owns(request, agent)):
            raise Http404
        return view(request, agent)

    return guarded


def owns(request: HttpRequest, agent: Agent) -> bool:
    """Whether the person sees the agent in the administration, too."""
    user = request.user
    return user.is_active and (user.is_superuser or user.pk == agent.owner_id)


@shown
def page(request: HttpRequest, agent: Agent) -> HttpResponse:
    """The page; its modules fill it."""
    context = {
        "agent": agent,
        "run": live.run_of(request, agent),
        "runs": agent.runs.order_by("-number"),
        "owned": owns(request, agent),
        "places": has_places(agent),
    }
    return render(request, "frontend/agent.html", context)


def shared(tell: Callable[[HttpRequest, Agent], dict[str, Any]]) -> View:
    """A view of what `tell` says as JSON. Strangers who ask for the same within a second are told the same."""
    recent = Recent()

    @wraps(tell)
    def view(request: HttpRequest, agent: Agent) -> HttpResponse:
        if owns(request, agent):
            return JsonResponse(tell(request, agent))
        asked = tuple(
            request.GET.get(name, "") for name in ASKED
        )  # whatever else an address says, the answer is the same
        return JsonResponse(recent.get((agent.pk, asked), lambda: tell(request, agent)))

    return view


@shown
@shared
def curve(request: HttpRequest, agent: Agent) -> dict[str, Any]:
    """The curve of a run; short when the reader has all of it."""
    return live.curve(request, agent)


@shown
@shared
def executions(request: HttpRequest, agent: Agent) -> dict[str, Any]:
    """The live executions, and whether they can be asked."""
    statuses, notice = live.executions(agent)
    told = [for_everybody(status, owns(request, agent)) for status in statuses]
    return {"executions": told, "notice": notice and "The executions cannot be reached just now."}


@shown
@shared
def actions(request: HttpRequest, agent: Agent) -> dict[str, Any]:
    """What is counted of a run's actions; short when the reader has all of it."""
    run = live.run_of(request, agent)
    if live.has_all(request, tallies.version(run)):
        return live.UNCHANGED
    return tallies.read(run)


@require_safe
@gzip_page
def file(request: HttpRequest, file: str) -> HttpResponseBase:
    """A module or style sheet of the page: the same for all agents."""
    return serve_part(request, FOLDER, file, PUBLIC)


def for_everybody(status: ExecutionStatus, owned: bool) -> dict[str, Any]:
    """What the page tells of an execution. Agents that advise it are named to their owner alone."""
    advisors = [it if owned or isinstance(it, int) else SOMEBODY for it in status.get("advisors", [])]
    return {key: value for key, value in status.items() if key in TOLD} | {"advisors": advisors}


def has_places(agent: Agent) -> bool:
    """Whether the actions are the places of Bored in the city: the agent keeps the contract of docs/bored.md."""
    return agent.action_space == places() and agent.observation_space == OBSERVATION_OF_BORED


@cache
def places() -> int:
    """How many places there are."""
    return len(json.loads((bored_pages.FOLDER / "places.json").read_text("utf-8"))["places"])
