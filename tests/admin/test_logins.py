"""Log-in to the admin: who guesses passwords waits, and what was tried is there to read."""

from __future__ import annotations

from datetime import timedelta

import pytest
from axes.models import AccessAttempt, AccessLog
from django.contrib.admin.models import LogEntry
from django.test import Client
from django.urls import reverse
from django.utils import timezone

from agents_app import audit
from agents_app.models import User
from tests.agents.makers import make_staff

RIGHT = {"username": "ann", "password": "secret-password"}
WRONG = {"username": "ann", "password": "guess"}


def log_in(data, address="10.0.0.1", browser=None, **headers):
    return (browser or Client()).post(reverse("admin:login"), data, REMOTE_ADDR=address, headers=headers)


@pytest.fixture
def locked(ann):
    """Ann's name is locked at an address."""
    answers = [log_in(WRONG) for _ in range(5)]
    assert [answer.status_code for answer in answers] == [200, 200, 200, 200, 429]
    return answers[-1]


def test_after_some_wrong_passwords_a_name_waits_at_that_address(locked):
    assert locked["Retry-After"] == "900"
    assert b"Wait 15 minutes" in locked.content
    assert log_in(RIGHT).status_code == 429
    assert log_in(RIGHT | {"username": "ann "}, **{"User-Agent": "another browser"}).status_code == 429


def test_nobody_is_locked_out_by_somebody_elsewhere(locked):
    make_staff("bob")
    assert log_in(RIGHT, "10.0.0.2").status_code == 302
    assert log_in(RIGHT | {"username": "bob"}).status_code == 302


def test_who_logs_in_comes_to_the_agents(ann):
    browser = Client()
    response = browser.post(reverse("admin:login"), RIGHT, follow=True)
    assert response.redirect_chain[-1][0] == reverse("admin:agents_app_agent_changelist")


def test_the_right_password_in_between_begins_anew(ann):
    for _ in range(2):
        assert {log_in(WRONG).status_code for _ in range(4)} == {200}
        assert log_in(RIGHT).status_code == 302


def test_it_is_over_after_a_while(locked):
    AccessAttempt.objects.update(attempt_time=timezone.now() - timedelta(minutes=16))
    assert log_in(RIGHT).status_code == 302


def test_behind_a_proxy_the_address_is_the_clients(locked, settings):
    settings.BEHIND_TLS = True
    assert log_in(RIGHT, **{"X-Forwarded-For": "10.0.0.1, 203.0.113.7"}).status_code != 429
    assert log_in(RIGHT, "10.0.0.9", **{"X-Forwarded-For": "10.0.0.1"}).status_code == 429


def test_no_password_is_kept(locked):
    row = AccessAttempt.objects.get()
    assert "guess" not in row.post_data + row.get_data


def test_a_superuser_reads_what_was_tried_and_lets_people_in(locked, boss):
    page = boss.get(reverse("admin:axes_accessattempt_changelist")).content
    assert b"10.0.0.1" in page
    row = AccessAttempt.objects.get()
    boss.post(reverse("admin:axes_accessattempt_delete", args=[row.pk]), {"post": "yes"})
    assert log_in(RIGHT).status_code == 302
    assert b"ann" in boss.get(reverse("admin:axes_accesslog_changelist")).content


@pytest.mark.parametrize("name", ["admin_logentry", "axes_accesslog", "axes_accessattempt"])
def test_other_staff_read_none_of_it(client, name, locked):
    assert client.get(reverse(f"admin:{name}_changelist")).status_code == 403
    assert (
        reverse(f"admin:{name}_changelist")
        not in client.get(reverse("admin:agents_app_agent_changelist")).content.decode()
    )


def test_nobody_edits_what_was_done(boss, agent):
    LogEntry.objects.log_actions(agent.owner_id, [agent], 2, change_message="Reset learning")
    entry = LogEntry.objects.get()
    assert b"Reset learning" in boss.get(reverse("admin:admin_logentry_changelist")).content
    assert boss.get(reverse("admin:admin_logentry_change", args=[entry.pk])).status_code == 200
    assert boss.post(reverse("admin:admin_logentry_change", args=[entry.pk]), {"object_repr": "x"}).status_code == 403
    assert boss.post(reverse("admin:admin_logentry_delete", args=[entry.pk]), {"post": "yes"}).status_code == 403


def test_what_is_done_with_keys_and_agents_is_kept(client, agent, boss):
    address = "admin:agents_app_agent_{}"
    key = agent.api_keys.get()
    client.post(reverse(address.format("make_key_view"), args=[agent.pk]), {"scope": "step"})
    client.post(reverse(address.format("action_view"), args=[agent.pk, "restart"]))
    client.post(reverse("admin:agents_app_apikey_changelist"), {"action": "revoke", "_selected_action": [key.pk]})
    page = boss.get(reverse("admin:admin_logentry_changelist")).content.decode()
    for words in (" made", "Restart executions", "Revoked"):
        assert words in page
    assert LogEntry.objects.filter(user__name="ann").count() == 3


def test_old_entries_are_forgotten(agent, settings):
    LogEntry.objects.log_actions(agent.owner_id, [agent], 2, change_message="old")
    LogEntry.objects.update(action_time=timezone.now() - timedelta(days=settings.AUDIT_DAYS + 1))
    LogEntry.objects.log_actions(agent.owner_id, [agent], 2, change_message="new")
    AccessLog.objects.create(username="ann", ip_address="10.0.0.1")
    audit.forget_old()
    assert [entry.change_message for entry in LogEntry.objects.all()] == ["new"]
    assert AccessLog.objects.count() == 1


@pytest.mark.parametrize(("password", "sentence"), [("short", "at least 10"), ("1234567890", "entirely numeric")])
def test_a_weak_password_is_refused(boss, password, sentence):
    data = {"name": "newcomer", "is_active": "on", "is_staff": "on", "new_password": password}
    assert sentence in boss.post(reverse("admin:agents_app_user_add"), data).content.decode()
    assert not User.objects.filter(name="newcomer").exists()
