"""The addresses of the web pages."""

from django.urls import URLPattern, path

from frontend import agent_pages, bored_pages

urlpatterns: list[URLPattern] = [
    path("bored/", bored_pages.page, name="bored"),
    path("bored/config.json", bored_pages.config, name="bored-config"),
    path("bored/map.json", bored_pages.street_map, name="bored-map"),
    path("bored/<path:file>", bored_pages.page, name="bored-file"),
    path("agents/<uuid:agent_id>/", agent_pages.page, name="agent"),
    path("agents/<uuid:agent_id>/curve.json", agent_pages.curve, name="agent-curve"),
    path("agents/<uuid:agent_id>/executions.json", agent_pages.executions, name="agent-executions"),
    path("agents/<uuid:agent_id>/actions.json", agent_pages.actions, name="agent-actions"),
    path("agents/<path:file>", agent_pages.file, name="agent-file"),
]
