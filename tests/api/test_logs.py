"""Logs: one event per line, with ids, never with a key."""

import io
import json
import logging
from logging.config import dictConfig

import pytest
import structlog
from django.conf import settings as django_settings

from agents_app.models import make_key
from envs_app.logs import logging_config
from tests.api.conftest import assert_problem

KEYS = [make_key("sk"), make_key("ss")]


@pytest.fixture(params=["json", "console"])
def log(request):
    """What is logged in this form."""
    config = logging_config("INFO", request.param)
    config["handlers"]["stderr"]["stream"] = stream = io.StringIO()
    dictConfig(config)
    yield stream
    dictConfig(django_settings.LOGGING)


def test_an_event_is_one_line_of_json_with_its_ids():
    config = logging_config("INFO", "json")
    config["handlers"]["stderr"]["stream"] = stream = io.StringIO()
    dictConfig(config)
    structlog.get_logger("shepherd.sessions").info("session opened", session=7, agent="a-1")
    logging.getLogger("django.request").warning("of another library: %s", "x")
    dictConfig(django_settings.LOGGING)
    ours, theirs = map(json.loads, stream.getvalue().splitlines())
    assert (ours["event"], ours["session"], ours["agent"], ours["level"]) == ("session opened", 7, "a-1", "info")
    assert (ours["logger"], theirs["logger"]) == ("shepherd.sessions", "django.request")
    assert theirs["event"] == "of another library: x"
    assert ours["timestamp"].endswith("Z")


@pytest.mark.parametrize("key", KEYS, ids=["API key", "session key"])
def test_a_key_is_cut_short_wherever_it_stands(log, key):
    structlog.get_logger("shepherd").warning(f"key {key}", key=key, deep={"list": [key]})
    logging.getLogger("other").error("refused %s", key)
    try:
        raise RuntimeError(f"Bearer {key}")
    except RuntimeError:
        logging.getLogger("other").exception("failed")
        structlog.get_logger("shepherd").exception("failed")
    assert key not in log.getvalue()
    assert key[12:] not in log.getvalue()
    assert log.getvalue().count(f"{key[:9]}…") >= 5


def test_nothing_else_is_cut(log):
    structlog.get_logger("shepherd").info(
        "9b2f6a9e-3a50-4c6e-9a3e-0a4be2f7f0d1 is_not_a_key task_of_the_executions_of_somebody"
    )
    assert "…" not in log.getvalue()
    assert "9b2f6a9e-3a50-4c6e-9a3e-0a4be2f7f0d1 is_not_a_key task_of_the_executions_of_somebody" in log.getvalue()


def test_a_failed_step_is_logged_with_its_traceback_and_whose_it_was(api, core, monkeypatch, log):
    where = {"session": 7, "execution": "e-1", "agent": "a-1"}
    monkeypatch.setattr("envs_app.views.step.handles.whereabouts", lambda key: where)
    core.answer = RuntimeError(f"no {KEYS[1]}")
    step = {"obs": 1, "reward": 0, "terminated": False, "truncated": False}
    assert_problem(api.post("/api/v1/step", step, KEYS[1]), 500, "internal_error")
    assert "RuntimeError" in log.getvalue()
    assert "Traceback (most recent call last)" in log.getvalue()
    assert all(value in log.getvalue() for value in ("e-1", "a-1", "internal_error"))
    assert KEYS[1] not in log.getvalue()


def test_refusals_that_the_client_can_mend_are_not_logged(api, core, log):
    assert_problem(api.post("/api/v1/step", {}, KEYS[1]), 422, "invalid_request")
    assert_problem(api.get("/api/v1/nothing"), 404, "not_found")
    assert log.getvalue() == ""
