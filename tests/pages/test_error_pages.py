"""Pages that cannot be shown say so in Shepherd's own look, and what one may do; dates are written the short way."""

from __future__ import annotations

import pytest
from django.template.loader import render_to_string
from django.urls import reverse

pytestmark = pytest.mark.django_db


@pytest.mark.parametrize(
    ("address", "code", "words"),
    [
        ("/no/such/page", 404, "nothing that you may see"),
        ("/admin/agents_app/apikey/add/", 403, "on the page of their agent"),
    ],
)
def test_the_page_says_what_one_may_do(client, address, code, words):
    response = client.get(address)
    assert response.status_code == code
    assert words in response.content.decode()
    assert "agents_app/plain.css" in response.content.decode()


def test_the_page_of_a_fault_needs_nothing_that_may_be_broken():
    assert "in its log" in render_to_string("500.html")


def test_dates_are_short(client, agent):
    agent.created_at = agent.created_at.replace(year=2026, month=3, day=9, hour=16, minute=5)
    agent.save()
    assert "2026-03-09 16:05" in client.get(reverse("admin:agents_app_agent_changelist")).content.decode()
