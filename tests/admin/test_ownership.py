"""Staff see and touch only what is theirs: every address of the admin, walked by a foreign member of staff."""

import json

import pytest
from axes.models import AccessAttempt, AccessLog
from django.contrib import admin
from django.contrib.admin.models import LogEntry
from django.test import Client
from django.urls import NoReverseMatch, URLPattern, URLResolver, reverse

from agents_app.models import Agent, Algorithm, APIKey, EpisodeReturn, Parameter, Run, Save, User

SHARED = {Algorithm, Parameter}  # all staff may read the catalogue
AUDIT = {LogEntry, AccessLog, AccessAttempt}  # for superusers alone
OWNED = set(admin.site._registry) - SHARED - AUDIT
SECRETS = (b"wolfhound", b"bob", b"123.25")


def names_of(patterns, prefix=""):
    """All named addresses below the admin."""
    for pattern in patterns:
        if isinstance(pattern, URLResolver):
            yield from names_of(pattern.url_patterns)
        elif isinstance(pattern, URLPattern) and pattern.name:
            yield pattern.name


def row_of(model, agent):
    """A row of the model that belongs to the agent."""
    if model is Agent:
        return agent
    if model is User:
        return agent.owner
    paths = {"agent": {"agent": agent}, "run": {"run__agent": agent}}
    fields = {field.name for field in model._meta.fields}
    return model.objects.filter(**next(paths[name] for name in paths if name in fields)).first()


def addresses(agent):
    """Every address of the admin with the agent, or a row of it, as its object; in all guises."""
    key = agent.api_keys.first()
    for name in sorted(set(names_of(admin.site.get_urls()[:]))):
        for arguments in ([], *arguments_of(name, agent, key)):
            try:
                yield reverse(f"admin:{name}", args=arguments)
            except NoReverseMatch:
                continue


def arguments_of(name, agent, key):
    for model in OWNED:
        if name.startswith(f"{model._meta.app_label}_{model._meta.model_name}_"):
            pk = row_of(model, agent).pk
            yield from ([pk], [pk, "reset"], [pk, "restart"], [pk, "delete_curve"], [pk, key.pk])


@pytest.fixture
def everything(agent, foreign):
    """Both agents have a past in the log, too."""
    for each in (agent, foreign):
        LogEntry.objects.log_actions(each.owner_id, [each], 2, change_message=f"changed {each.name}")
    return {
        model.__name__: list(model.objects.order_by("pk").values())
        for model in (Agent, APIKey, Run, Save, EpisodeReturn)
    }


def test_there_is_something_to_walk(everything, agent):
    walked = list(addresses(agent))
    assert len(walked) > 60
    assert any(address.endswith("/curve/") for address in walked)
    assert any(address.endswith("/revoke/") for address in walked)
    assert any(address.endswith("/history/") for address in walked)


def test_no_address_shows_what_is_foreign(everything, client, foreign):
    for address in addresses(foreign):
        response = client.get(address)
        content = b"".join(response.streaming_content) if response.streaming else response.content
        if b"/jsi18n/" not in address.encode():
            assert not any(secret in content for secret in SECRETS), address
        if str(foreign.pk) in address:
            assert response.status_code in (302, 403, 404), address


def test_no_post_touches_what_is_foreign(everything, client, foreign, fleet):
    for address in addresses(foreign):
        if "logout" not in address and "password_change" not in address:
            client.post(
                address, {"post": "yes", "name": "stolen", "scope": "manage", "is_superuser": "on", "is_staff": "on"}
            )
    after = {
        model.__name__: list(model.objects.order_by("pk").values())
        for model in (Agent, APIKey, Run, Save, EpisodeReturn)
    }
    assert after == everything
    assert User.objects.get(name="ann").is_superuser is False
    assert fleet.calls == []


def test_the_owner_sees_it_at_the_same_addresses(everything, client, agent):
    page = client.get(reverse("admin:agents_app_agent_change", args=[agent.pk]))
    assert page.status_code == 200
    for name in ("history", "curve_view", "live_view", "csv_view", "delete"):
        assert client.get(reverse(f"admin:agents_app_agent_{name}", args=[agent.pk])).status_code == 200
    for model in OWNED:
        address = reverse(f"admin:agents_app_{model._meta.model_name}_change", args=[row_of(model, agent).pk])
        assert client.get(address).status_code == 200, address


@pytest.mark.parametrize("who", ["stranger", "user without staff"])
def test_nobody_else_gets_in(everything, agent, who):
    browser = Client()
    if who != "stranger":
        browser.force_login(User.objects.create_user("client"))
    for address in addresses(agent):
        if address != reverse("admin:login") and "jsi18n" not in address:
            response = browser.get(address)
            assert response.status_code in (302, 404), address
            if response.status_code == 302:
                assert "login" in response["Location"] or response["Location"].startswith("/admin/"), address


def test_lists_show_only_ones_own(everything, client):
    for model in OWNED:
        content = client.get(reverse(f"admin:agents_app_{model._meta.model_name}_changelist")).content
        assert not any(secret in content for secret in (b"wolfhound", b"bob")), model


def test_searches_and_filters_do_not_reach_over(everything, client, foreign):
    for query in ("q=wolfhound", f"owner__id__exact={foreign.owner_id}", "o=1", "all="):
        content = client.get(reverse("admin:agents_app_agent_changelist") + f"?{query}", follow=True).content
        assert str(foreign.pk).encode() not in content


def test_autocomplete_of_owners_offers_oneself_alone(everything, client):
    query = {"app_label": "agents_app", "model_name": "agent", "field_name": "owner", "term": ""}
    found = json.loads(client.get(reverse("admin:autocomplete"), query).content)["results"]
    assert [each["text"] for each in found] == ["ann"]


def test_an_agent_cannot_be_given_away_or_taken(everything, client, agent, foreign):
    data = {"owner": foreign.owner_id, "name": "mine", "algorithm": agent.algorithm_id, "action_space": "4"}
    data |= {"observation_space": "[[8], -1, 1]"}
    client.post(reverse("admin:agents_app_agent_add"), data)
    assert Agent.objects.get(name="mine").owner.name == "ann"


def test_actions_on_lists_do_not_reach_over(everything, client, foreign):
    key = foreign.api_keys.get()
    data = {"action": "revoke", "_selected_action": [key.pk]}
    client.post(reverse("admin:agents_app_apikey_changelist"), data)
    key.refresh_from_db()
    assert key.revoked_at is None


def test_a_key_is_not_revoked_through_ones_own_agent(everything, client, agent, foreign):
    key = foreign.api_keys.get()
    address = reverse("admin:agents_app_agent_revoke_key_view", args=[agent.pk, key.pk])
    assert client.post(address).status_code == 404
    key.refresh_from_db()
    assert key.revoked_at is None


def test_staff_see_themselves_and_no_password(everything, client, ann):
    page = client.get(reverse("admin:agents_app_user_change", args=[ann.pk]))
    assert page.status_code == 200
    assert ann.password.encode() not in page.content
    assert b"md5$" not in page.content
    assert client.post(reverse("admin:agents_app_user_change", args=[ann.pk]), {"name": "king"}).status_code == 403


def test_superusers_see_everything(everything, boss, foreign):
    assert b"wolfhound" in boss.get(reverse("admin:agents_app_agent_changelist")).content
    assert boss.get(reverse("admin:agents_app_agent_change", args=[foreign.pk])).status_code == 200
    assert boss.get(reverse("admin:agents_app_user_change", args=[foreign.owner_id])).status_code == 200
