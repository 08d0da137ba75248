"""GET /healthz, /readyz and /metrics."""

import os
import re
from math import inf

import pytest
from django.db import OperationalError

from agents_app.models import APIKey, Execution, Session
from envs_app import errors, metrics
from tests.api.conftest import assert_problem


def test_health_asks_nobody(api):
    response = api.get("/healthz")  # without the mark of pytest-django, so any query fails
    assert (response.status_code, response.json()) == (200, {"status": "ok"})


def test_it_is_ready_when_database_and_executions_answer(api, db, fleet):
    response = api.get("/readyz")
    assert (response.status_code, response.json()) == (200, {"status": "ready"})


def test_it_is_not_ready_without_executions(api, db, fleet):
    fleet.unreachable = True
    assert_problem(api.get("/readyz"), 503, "unavailable", "executions")


def test_it_is_not_ready_without_a_database(api, db, fleet, monkeypatch):
    class Database:
        def cursor(self):
            raise OperationalError("connection refused")

    monkeypatch.setattr("envs_app.views.health.connection", Database())
    response = api.get("/readyz")
    assert_problem(response, 503, "unavailable", "database")
    assert response["Retry-After"] == "1"


def metric(api, name):
    """The value of the first line that begins with `name`; 0 without one."""
    response = api.get("/metrics")
    assert response.status_code == 200
    assert response["Content-Type"].startswith("text/plain")
    found = re.search(rf"^{re.escape(name)} (\S+)$", response.content.decode(), re.MULTILINE)
    return float(found[1]) if found else 0.0


STEP = {"obs": 1, "reward": 0, "terminated": False, "truncated": False}


@pytest.mark.parametrize("answer", ["ok", "step_pending", "internal_error"])
def test_metrics_count_and_time_steps_by_what_was_answered(api, db, fleet, core, answer):
    if answer != "ok":
        core.answer = RuntimeError() if answer == "internal_error" else errors.StepPending()
    name = f'shepherd_step_seconds_count{{code="{answer}"}}'
    before = metric(api, name)
    api.post("/api/v1/step", STEP, "ss_1")
    api.post("/shepherd/env/", {"session_key": "ss_1", "obs": 1})
    assert metric(api, name) == before + 2
    assert metric(api, f'shepherd_step_seconds_bucket{{code="{answer}",le="+Inf"}}') == before + 2
    assert metric(api, f'shepherd_step_seconds_sum{{code="{answer}"}}') > 0


def test_metrics_are_summed_over_web_processes(api, db, fleet, core):
    name = 'shepherd_step_seconds_count{code="ok"}'
    before = metric(api, name)
    api.post("/api/v1/step", STEP, "ss_1")
    if (child := os.fork()) == 0:
        metrics.observe_step("ok", 0.001)
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
    assert metric(api, name) == before + 2


def test_metrics_of_dead_servers_are_deleted(settings, monkeypatch):
    dead = settings.DATA_DIR / "metrics" / str(2**22 + 1)  # past the largest process id of Linux
    dead.mkdir(parents=True)
    monkeypatch.setenv(metrics.FOLDER_VARIABLE, "")
    folder = metrics._folder.__wrapped__()
    assert folder.exists()
    assert not dead.exists()


def test_metrics_count_open_sessions(api, agent, fleet):
    key = APIKey.issue(agent)[0]
    Session.objects.create(agent=agent, api_key=key, hash="1")
    Session.objects.create(agent=agent, api_key=key, hash="2", closed_at=agent.created_at)
    assert metric(api, "shepherd_sessions") == 1


def test_metrics_count_the_live_executions_of_each_agent(api, agent, fleet):
    Execution.objects.create(run=agent.current_run(), number=1)
    fleet.statuses = [{"number": 1}, {"number": 2}]
    assert metric(api, f'shepherd_executions{{agent="{agent.pk}"}}') == 2


def test_metrics_are_there_without_executions(api, agent, fleet):
    Execution.objects.create(run=agent.current_run(), number=1)
    fleet.unreachable = True
    assert metric(api, "shepherd_sessions") == 0
    assert b"shepherd_executions{" not in api.get("/metrics").content


def test_a_disk_that_is_full_loses_a_count_and_no_step(api, core, monkeypatch, caplog):
    def full(fd, start, length):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(metrics.os, "posix_fallocate", full)
    metrics._folder.cache_clear()
    metrics._by_code.clear()
    assert [api.post("/api/v1/step", STEP, "ss_1").status_code for _ in range(3)] == [200] * 3
    assert caplog.text.count("metrics cannot be kept") == 1
    monkeypatch.setattr(metrics._by_code, "failed_at", -inf)


@pytest.mark.parametrize("key", [None, "wrong", ""])
def test_metrics_are_for_who_has_their_key(api, settings, key):
    settings.METRICS_KEY = "for-prometheus"
    assert_problem(api.get("/metrics", key), 401, "invalid_api_key", "SHEPHERD_METRICS_KEY")


@pytest.mark.django_db
def test_who_has_the_key_of_the_metrics_reads_them(api, fleet, settings):
    settings.METRICS_KEY = "for-prometheus"
    assert api.get("/metrics", "for-prometheus").status_code == 200
