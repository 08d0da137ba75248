"""Users in the admin: only a name is needed; staff get a password."""

import pytest
from django.urls import reverse

from agents_app.models import User
from tests.agents.makers import make_agent

ADD = "admin:agents_app_user_add"


def page_of(user):
    return reverse("admin:agents_app_user_change", args=[user.pk])


def test_a_user_needs_only_a_name(boss):
    boss.post(reverse(ADD), {"name": "carla", "is_active": "on"})
    carla = User.objects.get(name="carla")
    assert not carla.has_usable_password()
    assert not carla.is_staff


def test_staff_need_a_password_and_log_in_with_it(boss, client):
    page = boss.post(reverse(ADD), {"name": "carla", "is_active": "on", "is_staff": "on"})
    assert "give a password" in str(page.context["adminform"].form.errors)
    boss.post(reverse(ADD), {"name": "carla", "is_active": "on", "is_staff": "on", "new_password": "a swordfish"})
    client.logout()
    assert client.post(reverse("admin:login"), {"username": "carla", "password": "a swordfish"}).status_code == 302
    assert client.get("/admin/agents_app/agent/").status_code == 200


def test_an_empty_password_leaves_it_and_leaving_staff_takes_it_away(boss, ann):
    boss.post(page_of(ann), {"name": "anna", "is_active": "on", "is_staff": "on"})
    ann.refresh_from_db()
    assert ann.name == "anna"
    assert ann.check_password("secret-password")
    boss.post(page_of(ann), {"name": "anna", "is_active": "on", "is_superuser": "on"})
    ann.refresh_from_db()
    assert not ann.has_usable_password()
    assert not ann.is_superuser


def test_who_changes_their_own_password_stays_logged_in(boss):
    me = User.objects.get(name="boss")
    data = {"name": "boss", "is_active": "on", "is_staff": "on", "is_superuser": "on", "new_password": "another-one"}
    boss.post(page_of(me), data)
    assert boss.get("/admin/agents_app/agent/").status_code == 200
    me.refresh_from_db()
    assert me.check_password("another-one")


def test_a_deleted_user_takes_their_agents_along(boss, agent, ann, fleet):
    address = reverse("admin:agents_app_user_delete", args=[ann.pk])
    assert b"with everything that belongs to it" in boss.get(address).content
    boss.post(address, {"post": "yes"})
    assert not User.objects.filter(name="ann").exists()
    assert ("restart", str(agent.pk)) in fleet.calls


def test_a_user_whose_executions_cannot_be_ended_stays(boss, agent, ann, fleet):
    fleet.unreachable = True
    page = boss.post(reverse("admin:agents_app_user_delete", args=[ann.pk]), {"post": "yes"}, follow=True)
    assert b"Not deleted" in page.content
    assert page.redirect_chain[-1][0] == page_of(ann)
    assert User.objects.filter(name="ann").exists()


def test_nobody_deletes_themselves(boss):
    me = User.objects.get(name="boss")
    assert boss.post(reverse("admin:agents_app_user_delete", args=[me.pk]), {"post": "yes"}).status_code == 403


@pytest.mark.parametrize("query", ["", "?q=a", "?is_staff__exact=1"])
def test_the_list_says_who_owns_how_much(boss, query):
    make_agent("one", "carla")
    assert boss.get(reverse("admin:agents_app_user_changelist") + query).status_code == 200
