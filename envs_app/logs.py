"""Structured logs: one line per event on standard error, as JSON or for people; never a key.

Events name the session, execution and agent by id. `hide_keys` sees every finished line, so that also a traceback or a
library's message cannot tell a key.
"""

from __future__ import annotations

import re
from typing import Any

import structlog

KEY = re.compile(r"\b([a-z]{2}_[\w-]{6})[\w-]{26}(?![\w-])")  # of agents_app.models.make_key; the shown prefix stays

SHARED: list[Any] = [
    structlog.contextvars.merge_contextvars,
    structlog.stdlib.add_log_level,
    structlog.stdlib.add_logger_name,
    structlog.processors.TimeStamper(fmt="iso"),
]


def hide_keys(_logger: Any, _method: str, line: str) -> str:
    """The line with every API key and session key cut short."""
    return KEY.sub(r"\1…", line)


def logging_config(level: str, form: str) -> dict[str, Any]:
    """Django's LOGGING for a level, and a form: `json` or `console`. Also sets up structlog."""
    structlog.configure(
        processors=[
            structlog.stdlib.filter_by_level,
            structlog.stdlib.PositionalArgumentsFormatter(),
            *SHARED,
            structlog.stdlib.ProcessorFormatter.wrap_for_formatter,
        ],
        logger_factory=structlog.stdlib.LoggerFactory(),
        wrapper_class=structlog.stdlib.BoundLogger,
        cache_logger_on_first_use=True,
    )
    return {
        "version": 1,
        "disable_existing_loggers": False,
        "formatters": {
            "line": {
                "()": structlog.stdlib.ProcessorFormatter,
                "foreign_pre_chain": SHARED,
                "processors": _render(form),
            }
        },
        "handlers": {"stderr": {"class": "logging.StreamHandler", "formatter": "line"}},
        "root": {"handlers": ["stderr"], "level": level},
        "loggers": {
            "django": {"handlers": [], "level": level, "propagate": True},
            "django.server": {"handlers": [], "level": level, "propagate": True},
            "axes": {"level": "WARNING"},  # agents_app.audit says what was done
        },
    }


def _render(form: str) -> list[Any]:
    """The steps from an event to a line."""
    forms: dict[str, list[Any]] = {
        "json": [structlog.processors.format_exc_info, structlog.processors.JSONRenderer()],
        "console": [structlog.dev.ConsoleRenderer(colors=False, exception_formatter=structlog.dev.plain_traceback)],
    }
    return [structlog.stdlib.ProcessorFormatter.remove_processors_meta, *forms[form], hide_keys]
