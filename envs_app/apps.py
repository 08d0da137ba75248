"""The Django application of environments."""

from django.apps import AppConfig


class EnvsConfig(AppConfig):
    """How a client's environment meets an agent: HTTP API, sessions, executions."""

    name = "envs_app"
    verbose_name = "Environments"

    def ready(self) -> None:
        """Register the checks of the settings."""
        import shepherd.checks  # noqa: F401
