"""Pages of any origin may call the API from a browser."""

import pytest

from tests.api.conftest import assert_problem

ORIGIN = "https://bored.example"


@pytest.mark.parametrize("path", ["/api/v1/step", "/api/v1/sessions", "/shepherd/env/", "/shepherd/login_user/"])
def test_a_browser_may_ask_before_it_posts(api, path):
    response = api.client.options(
        path,
        headers={
            "Origin": ORIGIN,
            "Access-Control-Request-Method": "POST",
            "Access-Control-Request-Headers": "authorization,content-type",
        },
    )
    assert response.status_code == 200
    assert response["Access-Control-Allow-Origin"] == "*"
    assert "POST" in response["Access-Control-Allow-Methods"]
    assert {"authorization", "content-type"} <= set(response["Access-Control-Allow-Headers"].split(", "))


def test_a_browser_may_read_the_reply_and_how_long_to_wait(api):
    response = api.post("/api/v1/step", {}, Origin=ORIGIN)
    assert_problem(response, 401, "unknown_session")
    assert response["Access-Control-Allow-Origin"] == "*"
    assert response["Access-Control-Expose-Headers"] == "Retry-After"


def test_cookies_are_never_allowed(api):
    assert "Access-Control-Allow-Credentials" not in api.post("/api/v1/step", {}, Origin=ORIGIN)


def test_other_pages_stay_closed(api, db):
    assert "Access-Control-Allow-Origin" not in api.client.get("/admin/login/", headers={"Origin": ORIGIN})


def test_origins_can_be_named(api, settings):
    settings.CORS_ALLOW_ALL_ORIGINS, settings.CORS_ALLOWED_ORIGINS = False, [ORIGIN]
    assert api.post("/api/v1/step", {}, Origin=ORIGIN)["Access-Control-Allow-Origin"] == ORIGIN
    assert "Access-Control-Allow-Origin" not in api.post("/api/v1/step", {}, Origin="https://evil.example")
