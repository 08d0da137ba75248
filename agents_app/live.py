"""What pages about an agent ask for every few seconds: the owner's in the administration, and the live page."""

from __future__ import annotations

from typing import Any

from django.http import Http404, HttpRequest

from agents_app import curves
from agents_app.fleet import ExecutionStatus, get_fleet
from agents_app.models import Agent, Run

UNCHANGED = {"unchanged": True}


def run_of(request: HttpRequest, agent: Agent) -> Run:
    """The run that the address names, else the current one. Raises Http404."""
    number = request.GET.get("run", "")
    if not number:
        return agent.current_run()
    run = (
        agent.runs.filter(number=number).first() if number.isascii() and number.isdigit() and len(number) < 10 else None
    )
    if run is None:
        raise Http404("There is no such run.")
    return run


def curve(request: HttpRequest, agent: Agent) -> dict[str, Any]:
    """The curve of the run; short when the reader has all of it."""
    run = run_of(request, agent)
    if has_all(request, curves.version(run)):
        return UNCHANGED
    return curves.read(run, by_execution=request.GET.get("by") == "execution")


def has_all(request: HttpRequest, version: int) -> bool:
    """Whether the reader says that this is the version that it has."""
    return request.GET.get("version") == str(version)


def executions(agent: Agent) -> tuple[list[ExecutionStatus], str]:
    """The live executions, and what stood in the way of asking them; empty: nothing did."""
    try:
        return get_fleet().status(str(agent.pk)), ""
    except ConnectionError as error:
        return [], f"The executions cannot be reached: {error}"
