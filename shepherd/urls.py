"""The addresses of Shepherd."""

from django.contrib import admin
from django.urls import URLPattern, URLResolver, include, path
from django.views.generic import RedirectView

urlpatterns: list[URLPattern | URLResolver] = [
    path("", include("envs_app.urls")),  # first, as a step is asked for most often
    path("", include("frontend.urls")),
    path("admin/", RedirectView.as_view(pattern_name="admin:agents_app_agent_changelist")),
    path("admin/", admin.site.urls),
    path("", RedirectView.as_view(pattern_name="admin:agents_app_agent_changelist")),
]
