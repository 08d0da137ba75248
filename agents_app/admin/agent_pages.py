"""The live part of an agent's page: curve, executions, errors, keys, downloads, and what can be done with an agent.

Everything starts from `agent_of`, which finds only what the person owns. Pages are read by GET; what changes anything
is a POST, and what destroys asks first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from django.contrib import messages
from django.core.exceptions import ValidationError
from django.http import (
    FileResponse,
    Http404,
    HttpRequest,
    HttpResponse,
    HttpResponseBase,
    HttpResponseNotAllowed,
    HttpResponseRedirect,
    JsonResponse,
    StreamingHttpResponse,
)
from django.shortcuts import get_object_or_404
from django.template.response import TemplateResponse
from django.urls import URLPattern, path, reverse
from django.utils.cache import add_never_cache_headers
from django.utils.text import slugify

from agents_app import live, services
from agents_app.admin.key_form import KeyForm, RenewalForm, sentences_of
from agents_app.live import run_of
from agents_app.models import Agent, APIKey, ExecutionError, Run

ERRORS_SHOWN = 5


@dataclass(frozen=True)
class Action:
    """Something to do with a run of an agent: `do` says what was done."""

    label: str
    icon: str
    do: Callable[[Agent, Run], str]
    question: str = ""  # asked before it is done; '': done at once


def _restart(agent: Agent, run: Run) -> str:
    return f"{services.restart(agent)} executions saved and ended. The next steps of their clients start new ones."


def _reset(agent: Agent, run: Run) -> str:
    return f"The agent learns from nothing: {services.reset_learning(agent)}. The run before can still be chosen here."


def _learn(agent: Agent, run: Run) -> str:
    services.set_learning(agent, True)
    return "The agent learns."


def _evaluate(agent: Agent, run: Run) -> str:
    services.set_learning(agent, False)
    return "The agent acts as well as it can, and learns nothing until you let it."


def _delete_saves(agent: Agent, run: Run) -> str:
    return f"{services.delete_saves(run)} saves of {run} deleted."


def _delete_curve(agent: Agent, run: Run) -> str:
    return f"{services.delete_curve(run)} returns of {run} deleted."


ACTIONS = {
    "evaluate": Action("Evaluate", "school", _evaluate),
    "learn": Action("Learn", "school", _learn),
    "restart": Action("Restart executions", "restart_alt", _restart),
    "reset": Action(
        "Reset learning",
        "replay",
        _reset,
        "The agent forgets what it learned and begins a new run. The curve and the saves of this run are kept.",
    ),
    "delete_saves": Action(
        "Delete saves",
        "folder_delete",
        _delete_saves,
        "All saves of this run go. Executions that live keep what they know, and share it "
        "if they average; else new ones begin from nothing.",
    ),
    "delete_curve": Action(
        "Delete curve",
        "delete",
        _delete_curve,
        "All returns of this run go, for good. What the agent knows stays.",
    ),
}
ALWAYS_SHOWN = ("restart", "reset", "delete_saves", "delete_curve")


class AgentPages:
    """Mix into the admin of agents."""

    change_form_outer_before_template = "agents_app/admin/agent_live.html"

    def get_urls(self) -> list[URLPattern]:
        """Below the agent's own address."""
        pages = {
            "curve/": self.curve_view,
            "live/": self.live_view,
            "returns.csv": self.csv_view,
            "model.zip": self.model_view,
            "do/<slug:name>/": self.action_view,
            "keys/": self.make_key_view,
            "keys/<int:key_id>/renew/": self.renew_key_view,
            "keys/<int:key_id>/revoke/": self.revoke_key_view,
        }
        site = self.admin_site  # type: ignore[attr-defined]
        own = [
            path(f"<path:object_id>/{address}", site.admin_view(view), name=f"agents_app_agent_{view.__name__}")
            for address, view in pages.items()
        ]
        return own + super().get_urls()  # type: ignore[misc]

    def agent_of(self, request: HttpRequest, object_id: str) -> Agent:
        """The agent, if it is the person's. Raises Http404."""
        agent = self.get_object(request, object_id)  # type: ignore[attr-defined]
        if agent is None or not self.has_change_permission(request, agent):  # type: ignore[attr-defined]
            raise Http404("There is no such agent.")
        return agent

    def change_view(
        self, request: HttpRequest, object_id: str, form_url: str = "", extra_context: dict[str, Any] | None = None
    ) -> HttpResponse:
        """The form, below what the agent does now."""
        agent = self.get_object(request, object_id)  # type: ignore[attr-defined]
        context = (extra_context or {}) | (live_context(request, agent) if agent else {})
        return super().change_view(request, object_id, form_url, context)  # type: ignore[misc]

    def curve_view(self, request: HttpRequest, object_id: str) -> HttpResponse:
        """The curve of a run as JSON; short when the reader has all of it."""
        return JsonResponse(live.curve(request, self.agent_of(request, object_id)))

    def live_view(self, request: HttpRequest, object_id: str) -> HttpResponse:
        """Executions and last errors as JSON."""
        agent = self.agent_of(request, object_id)
        executions, notice = live.executions(agent)
        errors = ExecutionError.objects.filter(run__agent=agent).order_by("-created_at", "-pk")[:ERRORS_SHOWN]
        return JsonResponse({"executions": executions, "notice": notice, "errors": [as_json(e) for e in errors]})

    def csv_view(self, request: HttpRequest, object_id: str) -> StreamingHttpResponse:
        """The returns of a run, as long as they may be."""
        agent = self.agent_of(request, object_id)
        run = run_of(request, agent)
        attachment = {"Content-Disposition": f'attachment; filename="{file_name(run, "csv")}"'}
        return StreamingHttpResponse(services.returns_csv([run]), content_type="text/csv", headers=attachment)

    def model_view(self, request: HttpRequest, object_id: str) -> HttpResponseBase:
        """The newest model of a run."""
        agent = self.agent_of(request, object_id)
        run = run_of(request, agent)
        try:
            found = services.model_zip(run)
        except ConnectionError as error:
            return back(request, agent, f"The executions cannot be reached: {error}")
        if found is None:
            return back(request, agent, "There is no model yet: one is saved when an execution has learned something.")
        return FileResponse(found, as_attachment=True, filename=file_name(run, "zip"))

    def action_view(self, request: HttpRequest, object_id: str, name: str) -> HttpResponse:
        """GET asks, POST does."""
        agent = self.agent_of(request, object_id)
        run = run_of(request, agent)
        if name not in ACTIONS:
            raise Http404("There is no such action.")
        action = ACTIONS[name]
        if request.method == "POST":
            return self.do(request, agent, run, action)
        if not action.question:
            return HttpResponseNotAllowed(["POST"])
        return self.page(request, agent, "agent_action", action=action, run=run, title=action.label)

    def do(self, request: HttpRequest, agent: Agent, run: Run, action: Action) -> HttpResponse:
        """Do it, and go back to the agent with what was done, or with what stood in the way."""
        try:
            done = action.do(agent, run)
        except ConnectionError as error:
            return back(request, agent, f"The executions cannot be reached: {error}. Try again later.", run)
        self.log_change(request, agent, action.label)  # type: ignore[attr-defined]
        messages.success(request, done)
        return HttpResponseRedirect(page_of(agent, run if action.do is not _reset else None))

    def make_key_view(self, request: HttpRequest, object_id: str) -> HttpResponse:
        """A new key. This answer is the only place where its secret ever stands."""
        agent = self.agent_of(request, object_id)
        if request.method != "POST":
            return HttpResponseNotAllowed(["POST"])
        form = KeyForm(request.POST)
        if not form.is_valid():
            return back(request, agent, f"No key was made. {sentences_of(form)}")
        key, secret = form.issue(agent)
        self.log_change(request, agent, f"API key {key} made")  # type: ignore[attr-defined]
        return self.show_key(request, agent, key, secret)

    def show_key(self, request: HttpRequest, agent: Agent, key: APIKey, secret: str) -> HttpResponse:
        """The only page that ever shows a secret."""
        server = request.build_absolute_uri("/").rstrip("/")
        return self.page(request, agent, "key_made", key=key, secret=secret, server=server, title="A new API key")

    def renew_key_view(self, request: HttpRequest, object_id: str, key_id: int) -> HttpResponse:
        """GET asks for how long the old key goes on, POST makes its successor."""
        agent = self.agent_of(request, object_id)
        key = get_object_or_404(APIKey, pk=key_id, agent=agent)
        if request.method != "POST":
            return self.page(request, agent, "key_renewal", key=key, title=f"Renew {key} {key.name}")
        form = RenewalForm(request.POST)
        if not form.is_valid():
            return back(request, agent, f"No key was made. {sentences_of(form)}")
        try:
            successor, secret = services.renew_key(key, form.cleaned_data["days"])
        except ValidationError as error:
            return back(request, agent, " ".join(error.messages))
        days = form.cleaned_data["days"]
        self.log_change(request, agent, f"API key {key} renewed as {successor}, and ends in {days} days")  # type: ignore[attr-defined]
        return self.show_key(request, agent, successor, secret)

    def revoke_key_view(self, request: HttpRequest, object_id: str, key_id: int) -> HttpResponse:
        """GET asks, POST revokes."""
        agent = self.agent_of(request, object_id)
        key = get_object_or_404(APIKey, pk=key_id, agent=agent)
        if request.method == "POST":
            services.revoke_key(key)
            self.log_change(request, agent, f"API key {key} revoked")  # type: ignore[attr-defined]
            messages.success(request, f"{key} opens nothing any more, and its sessions are closed.")
            return HttpResponseRedirect(page_of(agent))
        question = f"No client gets in with {key} any more, and the sessions that it opened are closed."
        action = Action("Revoke the key", "key_off", lambda agent, run: "", question)
        return self.page(request, agent, "agent_action", action=action, title=f"Revoke {key} {key.name}")

    def page(self, request: HttpRequest, agent: Agent, template: str, **context: Any) -> TemplateResponse:
        """A page of the admin about an agent, which no cache keeps."""
        site = self.admin_site  # type: ignore[attr-defined]
        context |= {**site.each_context(request), "agent": agent, "opts": Agent._meta, "back": page_of(agent)}
        response = TemplateResponse(request, f"agents_app/admin/{template}.html", context)
        add_never_cache_headers(response)
        return response


def live_context(request: HttpRequest, agent: Agent) -> dict[str, Any]:
    """What the live part of the page is made of. Counts nothing, so that a million returns cost nothing."""
    run = run_of(request, agent)
    return {
        "agent": agent,
        "run": run,
        "runs": agent.runs.order_by("-number"),
        "keys": agent.api_keys.order_by("revoked_at", "-created_at")[:50],
        "key_form": KeyForm(),
        "toggle": "evaluate" if agent.enable_learning else "learn",
        "toggle_action": ACTIONS["evaluate" if agent.enable_learning else "learn"],
        "actions_shown": [(name, ACTIONS[name]) for name in ALWAYS_SHOWN],
        "live_url": reverse("admin:agents_app_agent_live_view", args=[agent.pk]),
        "curve_url": reverse("admin:agents_app_agent_curve_view", args=[agent.pk]),
    }


def page_of(agent: Agent, run: Run | None = None) -> str:
    """The address of the agent's page."""
    page = reverse("admin:agents_app_agent_change", args=[agent.pk])
    return f"{page}?run={run.number}" if run else page


def back(request: HttpRequest, agent: Agent, sentence: str, run: Run | None = None) -> HttpResponse:
    """To the agent's page, with what went wrong."""
    messages.error(request, sentence)
    return HttpResponseRedirect(page_of(agent, run))


def file_name(run: Run, ending: str) -> str:
    """What a download of a run is called."""
    return f"{slugify(run.agent.name) or 'agent'}-run-{run.number}.{ending}"


def as_json(error: ExecutionError) -> dict[str, Any]:
    """An error as the page shows it."""
    return {"id": error.pk, "at": error.created_at, "summary": error.summary, "traceback": error.traceback}
