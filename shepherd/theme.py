"""The look of the admin: django-unfold's settings."""

from typing import Any

from django.http import HttpRequest
from django.templatetags.static import static
from django.urls import reverse_lazy


def _link(title: str, icon: str, model: str, app: str = "agents_app", **more: Any) -> dict[str, Any]:
    """An entry of the sidebar, to the list of a model."""
    return {"title": title, "icon": icon, "link": reverse_lazy(f"admin:{app}_{model}_changelist"), **more}


def _group(title: str, *items: dict[str, Any]) -> dict[str, Any]:
    return {"title": title, "separator": True, "items": list(items)}


def is_superuser(request: HttpRequest) -> bool:
    """Whether the person may see everything."""
    return bool(request.user.is_superuser)


FOR_SUPERUSERS = "shepherd.theme.is_superuser"
UNFOLD = {
    "SITE_TITLE": "Shepherd",
    "SITE_HEADER": "Shepherd",
    "SITE_SUBHEADER": "RL as a service",
    "SITE_ICON": lambda request: static("agents_app/shepherd.svg"),
    "SITE_FAVICONS": [
        {"rel": "icon", "type": "image/svg+xml", "href": lambda request: static("agents_app/shepherd.svg")}
    ],
    "SITE_URL": None,
    "SHOW_VIEW_ON_SITE": False,
    "BORDER_RADIUS": "8px",
    "STYLES": [
        lambda request: static("agents_app/live/live.css"),
        lambda request: static("agents_app/admin.css"),
    ],
    "COLORS": {
        "primary": {
            "50": "oklch(98.4% .014 180.7)",
            "100": "oklch(95.3% .051 180.8)",
            "200": "oklch(91% .096 180.4)",
            "300": "oklch(85.5% .138 181.1)",
            "400": "oklch(77.7% .152 181.9)",
            "500": "oklch(70.4% .14 182.5)",
            "600": "oklch(53% .105 184.7)",
            "700": "oklch(46.5% .09 186.4)",
            "800": "oklch(40.5% .075 188.2)",
            "900": "oklch(36% .06 188.4)",
            "950": "oklch(27.7% .046 192.5)",
        }
    },
    "SIDEBAR": {
        "show_search": False,
        "show_all_applications": False,
        "navigation": [
            _group("Agents", _link("Agents", "smart_toy", "agent"), _link("API keys", "key", "apikey")),
            _group(
                "What they lived through",
                _link("Runs", "timeline", "run"),
                _link("Executions", "memory", "execution"),
                _link("Sessions", "forum", "session"),
                _link("Returns", "show_chart", "episodereturn"),
                _link("Saves", "save", "save"),
                _link("Errors", "error", "executionerror"),
            ),
            _group(
                "Catalogue", _link("Algorithms", "neurology", "algorithm"), _link("Parameters", "tune", "parameter")
            ),
            _group(
                "People",
                _link("Users", "group", "user", permission=FOR_SUPERUSERS),
                _link("Actions", "history", "logentry", "admin", permission=FOR_SUPERUSERS),
                _link("Log-ins", "login", "accesslog", "axes", permission=FOR_SUPERUSERS),
                _link("Wrong passwords", "lock", "accessattempt", "axes", permission=FOR_SUPERUSERS),
                {"title": "Your password", "icon": "password", "link": reverse_lazy("admin:password_change")},
            ),
        ],
    },
}
