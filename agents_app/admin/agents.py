"""Agents in the admin: configuring them, and their live page (agent_pages)."""

from __future__ import annotations

from typing import Any

from django import forms
from django.contrib import admin, messages
from django.contrib.admin.widgets import RelatedFieldWidgetWrapper
from django.db import transaction
from django.db.models import Field, ForeignKey, QuerySet
from django.http import HttpRequest, HttpResponse, HttpResponseRedirect
from django.urls import reverse
from unfold.decorators import display

from agents_app import services
from agents_app.admin.agent_form import PREFIX, form_for
from agents_app.admin.agent_pages import AgentPages
from agents_app.admin.owned import DeletesMuch
from agents_app.algorithms.registry import BY_NAME
from agents_app.models import Agent, Algorithm

BASICS = ("name", "algorithm", "action_space", "observation_space")
ADVICE = (
    "advice_method",
    "advisors",
    "peers_advise",
    "advisor",
    "advisor_save",
    "advice_form",
    "rho",
    "continuous_advice",
    "advice_samples",
    "last_word",
    "advice_weight",
    "psi",
    "shaping_scale",
    "learning_correction",
)
ADVISED, INTERSECTED = "advice_method != 'none'", "advice_method == 'intersection'"
EXECUTIONS = (
    "max_percent_cpu",
    "max_executions",
    "sessions_per_execution",
    "answer_within",
    "unanswered_reward",
    "save_interval",
    "start_from",
)
SHOWN = ("public", "counted_in")  # on the live page
AT_RESTART = {"policy", "action_space", "observation_space", "action_masks", "action_features", *ADVICE, "start_from"}
AT_RESTART |= {"averaging", "answer_within", "unanswered_reward"}


def advice_fields(agent: Agent) -> dict[str, Any]:
    """The settings of advice, and of learning together, that mean anything to the agent."""
    row = BY_NAME.get(agent.algorithm.name)
    averaging = ("averaging",) if row is not None and row.averages else ()
    if row is None or not row.advice:
        return {"fields": (*averaging, "advice_method"), "description": f"{agent.algorithm} takes no advice."}
    idle = {"continuous_advice", "advice_samples"} if isinstance(agent.action_space, int) else {"rho"}
    idle |= set() if row.corrects else {"learning_correction"}
    return {"fields": [*averaging, *(name for name in ADVICE if name not in idle)]}


def takes_setting_of_masks(agent: Agent) -> bool:
    """Whether its owner decides that actions can be masked. MaskablePPO's always can be."""
    row = BY_NAME.get(agent.algorithm.name)
    return row is not None and row.masks and row.family != "maskable" and isinstance(agent.action_space, int)


def takes_features(agent: Agent) -> bool:
    """Whether its owner can say what the actions are like."""
    row = BY_NAME.get(agent.algorithm.name)
    return row is not None and row.scores and isinstance(agent.action_space, int)


@admin.register(Agent)
class AgentAdmin(AgentPages, DeletesMuch):
    """What an agent is and does."""

    owner_path = "owner"
    list_display = ("name", "owner", "algorithm", "learning", "advice_method", "created_at", "last_activity_at")
    list_filter: Any = ("algorithm", "enable_learning", "advice_method")
    list_select_related = ("owner", "algorithm")
    search_fields = ("name", "owner__name")
    autocomplete_fields = ("owner",)
    warn_unsaved_form = True
    conditional_fields = {  # each is shown where it changes anything
        **dict.fromkeys(["advisors", "peers_advise", "advisor", "advisor_save", "advice_form", "rho"], ADVISED),
        **dict.fromkeys(["continuous_advice", "last_word"], INTERSECTED),
        "advice_samples": f"{INTERSECTED} && continuous_advice == 'sampling'",
        "advice_weight": "advice_method == 'geometric'",
        "psi": "advice_method == 'reuse'",
        "shaping_scale": "advice_method == 'shaping'",
        "learning_correction": f"{ADVISED} && advice_method != 'shaping'",
    }
    actions = None  # deleting agents, which ends executions, goes one by one

    def get_fieldsets(self, request: HttpRequest, obj: Agent | None = None) -> Any:
        """First what cannot wait; the rest, with the parameters of the algorithm, once the agent exists."""
        owner = ("owner",) if request.user.is_superuser else ()
        if obj is None:
            return [(None, {"fields": (*owner, *BASICS)})]
        of_actions: tuple[str, ...] = ("action_masks",) if takes_setting_of_masks(obj) else ()
        of_actions += ("action_features",) if takes_features(obj) else ()
        parameters = [PREFIX + name for name in obj.algorithm.parameters.values_list("name", flat=True)]
        return [
            (
                "Agent",
                {"classes": ["tab"], "fields": (*owner, *BASICS, "policy", *of_actions, "enable_learning", *SHOWN)},
            ),
            ("Parameters", {"classes": ["tab"], "fields": parameters}),
            ("Advice", {"classes": ["tab"], **advice_fields(obj)}),
            ("Executions", {"classes": ["tab"], "fields": EXECUTIONS}),
        ]

    def get_readonly_fields(self, request: HttpRequest, obj: Agent | None = None) -> tuple[str, ...]:
        """The algorithm is fixed."""
        return () if obj is None else ("algorithm",)

    def get_form(
        self, request: HttpRequest, obj: Agent | None = None, change: bool = False, **kwargs: Any
    ) -> type[forms.ModelForm]:
        """With a field per parameter."""
        kwargs["form"] = form_for(request.user, obj.algorithm if obj else None)
        return super().get_form(request, obj, change, **kwargs)

    def formfield_for_foreignkey(self, db_field: ForeignKey[Any, Any], request: HttpRequest, **kwargs: Any) -> Any:
        """New agents take listed algorithms."""
        field = super().formfield_for_foreignkey(db_field, request, **kwargs)
        if db_field.name == "algorithm" and field:
            field.queryset = Algorithm.objects.filter(listed=True)
            choices = [(row.pk, f"{row}: {row.description}") for row in field.queryset]
            field.choices = [("", "Choose one"), *choices]
        return field

    def formfield_for_dbfield(self, db_field: Field[Any, Any], request: HttpRequest, **kwargs: Any) -> Any:
        """Choices are chosen here, and edited elsewhere."""
        field = super().formfield_for_dbfield(db_field, request, **kwargs)
        if field and isinstance(field.widget, RelatedFieldWidgetWrapper):
            field.widget = field.widget.widget
        return field

    def get_changeform_initial_data(self, request: HttpRequest) -> dict[str, Any]:
        """Most people make agents for themselves."""
        return {"owner": request.user.pk} | super().get_changeform_initial_data(request)

    def add_view(
        self, request: HttpRequest, form_url: str = "", extra_context: dict[str, Any] | None = None
    ) -> HttpResponse:
        """One way on: to the agent's page."""
        one_button = {"show_save_and_continue": False, "show_save_and_add_another": False}
        return super().add_view(request, form_url, (extra_context or {}) | one_button)

    def get_queryset(self, request: HttpRequest) -> QuerySet[Agent]:
        """With what each row shows."""
        return super().get_queryset(request).select_related("owner", "algorithm")

    def save_model(self, request: HttpRequest, obj: Agent, form: forms.ModelForm, change: bool) -> None:
        """The agent, its parameters, its first run; then the live executions are told."""
        super().save_model(request, obj, form, change)
        services.set_parameters(obj, form.parameters() if change else {})  # type: ignore[attr-defined]
        obj.current_run()
        if change:
            transaction.on_commit(lambda: self.tell(request, obj, form.changed_data))

    def tell(self, request: HttpRequest, agent: Agent, changed: list[str]) -> None:
        """What changes at once changes; what waits for a restart is said."""
        try:
            services.tell_fleet(agent, changed)
        except ConnectionError as error:
            messages.warning(request, f"Saved, but the executions could not be told ({error}).")
        if any(name in AT_RESTART or name.startswith(PREFIX) for name in changed):
            messages.info(request, "Executions that run now take the change when they are restarted.")

    def response_add(self, request: HttpRequest, obj: Agent, post_url_continue: str | None = None) -> HttpResponse:
        """On to the parameters and the first key."""
        messages.success(request, f"{obj} exists. Make an API key for its clients; set parameters if you like.")
        return HttpResponseRedirect(reverse("admin:agents_app_agent_change", args=[obj.pk]))

    def delete_model(self, request: HttpRequest, obj: Agent) -> None:
        """With its executions and saves."""
        services.delete_agent(obj)

    @display(description="Learning", label={"learns": "success", "acts only": "warning"}, ordering="enable_learning")
    def learning(self, agent: Agent) -> str:
        """Whether it does."""
        return "learns" if agent.enable_learning else "acts only"
