"""What the API says at addresses where nothing is, and what it leaves out."""

import pytest

from tests.api.conftest import assert_problem


@pytest.mark.parametrize("path", ["/api/", "/api/v1/", "/api/v1/stepp", "/api/v1/step/", "/api/v2/step", "/healthz/x"])
def test_an_unknown_address_is_a_problem(api, path):
    assert_problem(api.post(path, {}), 404, "not_found", "nothing at this address")


def test_the_api_sets_no_cookies(api, core):
    assert not api.get("/healthz").cookies
    assert not api.post("/api/v1/step", {}).cookies


def test_replies_are_not_to_be_guessed_at(api):
    assert api.get("/healthz")["X-Content-Type-Options"] == "nosniff"


def test_head_is_answered(api):
    assert api.client.head("/healthz").status_code == 200


def test_pages_for_people_keep_their_own_errors(api, db):
    response = api.get("/nothing")
    assert response.status_code == 404
    assert response["Content-Type"].startswith("text/html")
