"""The Django application of the web pages."""

from django.apps import AppConfig


class FrontendConfig(AppConfig):
    """Web pages for people who are no developers."""

    name = "frontend"
    verbose_name = "Web pages"
