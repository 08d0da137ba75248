"""The addresses of the web pages."""

from django.urls import URLPattern, path

from frontend import views

urlpatterns: list[URLPattern] = [
    path("bored/", views.page, name="bored"),
    path("bored/config.json", views.config, name="bored-config"),
    path("bored/map.json", views.street_map, name="bored-map"),
    path("bored/<path:file>", views.page, name="bored-file"),
]
