"""Owners make, renew and revoke the keys of an agent."""

from datetime import timedelta

import pytest
from django.urls import reverse
from django.utils import timezone

from agents_app.models import APIKey, hash_key
from tests.admin.pages import url


def test_a_key_is_shown_once(client, agent):
    page = client.post(url(agent, "make_key_view"), {"name": "lab", "scope": "step"})
    secret = page.context["secret"]
    assert secret in page.content.decode()
    assert "no-store" in page["Cache-Control"]
    key = APIKey.objects.get(hash=hash_key(secret))
    assert (key.agent, key.name, key.scope) == (agent, "lab", "step")
    for address in (url(agent), url(agent, "history"), reverse("admin:agents_app_apikey_changelist")):
        assert secret not in client.get(address).content.decode()


def test_a_publishable_key_stays_readable(client, agent):
    made = client.post(
        url(agent, "make_key_view"), {"scope": "publishable", "origins": "https://a.example, http://b.example/"}
    )
    key = APIKey.objects.get(hash=hash_key(made.context["secret"]))
    assert (key.scope, key.origins) == ("step", ["https://a.example", "http://b.example"])
    assert b"https://a.example" in made.content
    for address in (url(agent), reverse("admin:agents_app_apikey_change", args=[key.pk])):
        page = client.get(address).content.decode()
        assert key.published in page
        assert "publishable https://a.example http://b.example" in page


def test_a_key_is_renewed_and_both_open_the_agent_for_a_while(client, agent, foreign):
    key = agent.api_keys.get()
    APIKey.objects.filter(pk=key.pk).update(scope="step", steps_per_minute=60)
    assert b"goes on for" in client.get(url(agent, "renew_key_view", key.pk)).content
    secret = client.post(url(agent, "renew_key_view", key.pk), {"days": "7"}).context["secret"]
    key.refresh_from_db()
    new = APIKey.objects.get(hash=hash_key(secret))
    assert (new.agent, new.name, new.scope, new.steps_per_minute, new.expires_at) == (agent, key.name, "step", 60, None)
    assert key.successor == new
    assert key.is_valid()
    assert timedelta(days=6, hours=23) < key.expires_at - timezone.now() < timedelta(days=7)
    assert b"renewed as" in client.get(url(agent, "history")).content
    again = client.post(url(agent, "renew_key_view", key.pk), {"days": "7"}, follow=True)
    assert b"has a successor already" in again.content
    assert agent.api_keys.count() == 2
    assert client.post(url(agent, "renew_key_view", foreign.api_keys.get().pk), {"days": "7"}).status_code == 404


def test_renewing_never_gives_a_key_more_time(client, agent):
    soon = timezone.now() + timedelta(days=1)
    agent.api_keys.update(expires_at=soon)
    client.post(url(agent, "renew_key_view", agent.api_keys.get().pk), {"days": "7"})
    assert agent.api_keys.get(successor__isnull=False).expires_at == soon


@pytest.mark.parametrize("days", ["", "-1", "366", "x"])
def test_a_key_is_renewed_only_for_a_number_of_days(client, agent, days):
    client.post(url(agent, "renew_key_view", agent.api_keys.get().pk), {"days": days})
    assert agent.api_keys.count() == 1


def test_a_key_may_expire(client, agent):
    client.post(url(agent, "make_key_view"), {"name": "for a course", "scope": "step", "days": "7"})
    left = APIKey.objects.get(name="for a course").expires_at - timezone.now()
    assert timedelta(days=6, hours=23) < left < timedelta(days=7)


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        ({"scope": "publishable", "origins": "example.org"}, "is no origin"),
        ({"scope": "manage", "origins": "https://example.org"}, "Only publishable keys"),
        ({"scope": "all"}, "not one of the available choices"),
        ({"scope": "step", "days": "0"}, "greater than or equal to 1"),
    ],
)
def test_a_key_that_makes_no_sense_is_not_made(client, agent, data, sentence):
    page = client.post(url(agent, "make_key_view"), data, follow=True).content.decode()
    assert "No key was made" in page
    assert sentence in page
    assert agent.api_keys.count() == 1


def test_a_revoked_key_closes_its_sessions(client, agent):
    key = agent.api_keys.get()
    assert b"No, go back" in client.get(url(agent, "revoke_key_view", key.pk)).content
    client.post(url(agent, "revoke_key_view", key.pk))
    key.refresh_from_db()
    assert not key.is_valid()
    assert key.sessions.get().closed_at


def test_keys_are_revoked_from_their_list_and_never_edited(client, agent):
    key = agent.api_keys.get()
    page = reverse("admin:agents_app_apikey_change", args=[key.pk])
    assert client.post(page, {"name": "other"}).status_code == 403
    assert client.get(reverse("admin:agents_app_apikey_add")).status_code == 403
    client.post(reverse("admin:agents_app_apikey_changelist"), {"action": "revoke", "_selected_action": [key.pk]})
    key.refresh_from_db()
    assert key.revoked_at
