"""The addresses of the API. The most frequent one comes first, as Django tries them in order."""

from django.urls import URLPattern, path, re_path
from drf_spectacular.views import SpectacularAPIView, SpectacularSwaggerSplitView

from envs_app.views.agent import AgentView, ModelView, ReturnsView
from envs_app.views.health import HealthView, ReadyView
from envs_app.views.legacy import EnvView, LoginView
from envs_app.views.metrics import MetricsView
from envs_app.views.sessions import SessionsView, SessionView
from envs_app.views.step import StepView

urlpatterns: list[URLPattern] = [
    path("api/v1/step", StepView.as_view(), name="step"),
    path("api/v1/sessions", SessionsView.as_view(), name="sessions"),
    path("api/v1/session", SessionView.as_view(), name="session"),
    path("api/v1/agent", AgentView.as_view(), name="agent"),
    path("api/v1/agent/returns", ReturnsView.as_view(), name="agent-returns"),
    path("api/v1/agent/model", ModelView.as_view(), name="agent-model"),
    re_path(r"^shepherd/env/?$", EnvView.as_view(), name="legacy-env"),
    re_path(r"^shepherd/login_user/?$", LoginView.as_view(), name="legacy-login"),
    path("healthz", HealthView.as_view(), name="health"),
    path("readyz", ReadyView.as_view(), name="ready"),
    path("metrics", MetricsView.as_view(), name="metrics"),
    path("api/schema/", SpectacularAPIView.as_view(), name="schema"),
    path("api/docs/", SpectacularSwaggerSplitView.as_view(url_name="schema"), name="docs"),
]
