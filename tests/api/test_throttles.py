"""Throttles: who asks too often is told to wait, and everybody else goes on."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest
from django.core.cache import cache

from agents_app.models import APIKey, Session
from envs_app import counters, throttles
from envs_app.counters import CacheCounters, FileCounters, get_counters
from envs_app.errors import Forbidden, Throttled
from envs_app.guards import guard_of
from envs_app.requests import Caller
from tests.api.conftest import assert_problem

HOUSE, NEIGHBOURS = "2001:db8:1:2::5", "2001:db8:1:3::5"


@pytest.fixture
def opened(monkeypatch):
    """Sessions are rows that lead nowhere."""

    def open_session(api_key):
        return Session(agent=api_key.agent, api_key=api_key), "ss_secret"

    monkeypatch.setattr("envs_app.views.sessions.open_session", open_session)
    monkeypatch.setattr("envs_app.views.legacy.open_session", open_session)


class At(Caller):
    """A caller from somewhere."""

    def __init__(self, rf, address="10.0.0.1", origin="https://a.example"):
        super().__init__(rf.post("/", REMOTE_ADDR=address, HTTP_ORIGIN=origin))


def test_a_key_opens_so_many_sessions_a_minute_from_one_address(api, opened, step_key, settings):
    settings.LOGINS = 3
    answers = [api.post("/api/v1/sessions", {}, step_key) for _ in range(4)]
    assert [answer.status_code for answer in answers] == [201, 201, 201, 429]
    assert_problem(answers[3], 429, "throttled", "3 sessions from this address")
    assert 1 <= int(answers[3]["Retry-After"]) <= 60
    old = api.post("/shepherd/login_user/", {"apikey": step_key})
    assert (old.status_code, old.json()["ok"]) == (429, False)


def test_a_publishable_key_has_throttles_of_its_own(api, opened, agent, settings):
    settings.PUBLISHABLE_LOGINS = 1
    key = APIKey.issue(agent, publishable=True)[1]
    codes = [api.post("/api/v1/sessions", {}, key, Origin="http://testserver").status_code for _ in range(2)]
    assert codes == [201, 429]


def test_other_addresses_and_keys_go_on(api, opened, agent, step_key, settings):
    settings.LOGINS = 1
    assert [api.post("/api/v1/sessions", {}, step_key).status_code for _ in range(2)] == [201, 429]
    assert api.client.post("/api/v1/sessions", headers={"Authorization": f"Bearer {step_key}"}, REMOTE_ADDR="10.9.9.9")
    assert api.post("/api/v1/sessions", {}, APIKey.issue(agent)[1]).status_code == 201


def test_no_limit_is_no_limit(api, opened, step_key, settings):
    settings.LOGINS = 0
    assert {api.post("/api/v1/sessions", {}, step_key).status_code for _ in range(20)} == {201}


def test_a_budget_is_of_all_clients_together(agent, rf):
    guard = guard_of(APIKey.issue(agent, steps_per_minute=2)[0])
    guard.admit(At(rf, "10.0.0.1"), 1)
    guard.admit(At(rf, "10.0.0.2", origin=""), 2)
    with pytest.raises(Throttled, match="2 steps a minute of all its clients") as refusal:
        guard.admit(At(rf, "10.0.0.3"), 3)
    assert 0 < refusal.value.retry_after <= 60


def test_a_large_budget_is_spread_over_the_minute(agent, rf):
    guard = guard_of(APIKey.issue(agent, steps_per_minute=65)[0])
    for _ in range(10):  # in ten seconds, a sixth of it
        guard.admit(At(rf), 1)
    with pytest.raises(Throttled) as refusal:
        guard.admit(At(rf), 1)
    assert 0 < refusal.value.retry_after <= throttles.PACE


def test_steps_with_a_publishable_key_are_counted_by_address(agent, rf, settings):
    settings.PUBLISHABLE_STEPS = 1
    guard = guard_of(APIKey.issue(agent, publishable=True, origins=["https://a.example"])[0])
    guard.admit(At(rf, HOUSE), 1)
    with pytest.raises(Throttled, match="1 steps a minute from this address"):
        guard.admit(At(rf, HOUSE.replace("::5", "::6")), 2)  # a household has a whole /64 of addresses
    guard.admit(At(rf, NEIGHBOURS), 3)
    guard.admit(At(rf, "::ffff:10.0.0.1"), 4)
    with pytest.raises(Throttled):
        guard.admit(At(rf, "10.0.0.1"), 5)
    with pytest.raises(Forbidden):
        guard.admit(At(rf, origin="https://b.example"), 6)


def test_who_steps_too_often_in_a_cafe_is_refused_and_the_other_visitors_go_on(agent, rf, settings):
    settings.PUBLISHABLE_SESSION_STEPS, settings.PUBLISHABLE_STEPS = 3, 10
    guard = guard_of(APIKey.issue(agent, publishable=True, origins=["https://a.example"])[0])
    for _ in range(3):
        guard.admit(At(rf), 1)
    for _ in range(20):  # and what is refused is nobody else's
        with pytest.raises(Throttled, match="3 steps a minute in this session"):
            guard.admit(At(rf), 1)
    for visitor in range(2, 9):
        guard.admit(At(rf), visitor)
    with pytest.raises(Throttled, match="10 steps a minute from this address"):
        guard.admit(At(rf), 9)


def test_three_hundred_quick_steps_of_a_page_are_taken(agent, rf):
    guard = guard_of(APIKey.issue(agent, publishable=True, origins=["https://a.example"])[0])
    for _ in range(300):
        guard.admit(At(rf), 1)


def test_nothing_stands_before_a_secret_key_without_a_budget(agent):
    assert guard_of(APIKey.issue(agent)[0]) is None


def test_a_new_span_of_time_begins_anew(tmp_path, monkeypatch):
    now = [1000.0]
    monkeypatch.setattr(counters, "now", lambda: now[0])
    counter = FileCounters(tmp_path / "counters")
    assert [counter.add("a", 10), counter.add("a", 10), counter.add("b", 10), counter.add("a", 10)] == [1, 2, 1, 3]
    now[0] += 10
    assert counter.add("a", 10) == 1


def count_often(path: str) -> list[int]:
    counter = FileCounters(Path(path))
    return [counter.add("all", 1e9) for _ in range(500)]


def test_processes_count_together_and_lose_nothing(tmp_path):
    path = str(tmp_path / "counters")
    with ProcessPoolExecutor(3) as pool:
        counts = sorted(count for part in pool.map(count_often, [path] * 3) for count in part)
    assert counts == list(range(1, 1501))


def test_without_room_on_the_disk_a_process_counts_alone(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(counters.os, "posix_fallocate", full)
    counter = FileCounters(tmp_path / "counters")
    assert [counter.add("a", 1e9), counter.add("a", 1e9)] == [1, 2]


def test_redis_counts_across_machines_and_its_loss_throttles_nobody(redis_server, settings):
    caches = {"LOCATION": redis_server.url, "OPTIONS": {"socket_connect_timeout": 2.0}}
    settings.CACHES = {"default": {"BACKEND": "django.core.cache.backends.redis.RedisCache", **caches}}
    settings.REDIS_URL = redis_server.url
    counter = get_counters()
    assert isinstance(counter, CacheCounters)
    assert [counter.add("a", 1e9), CacheCounters().add("a", 1e9), counter.add("b", 1e9)] == [1, 2, 1]
    counter.add("soon over", 60)
    assert 0 < int(redis_server.command("ttl", redis_server.command("keys", "*soon over*"))) <= 61
    redis_server.kill()
    assert counter.add("a", 1e9) == 0
    cache.close()
