"""The Content-Security-Policy in a real browser: every page works under it, and what is smuggled in does not run."""

from __future__ import annotations

import pytest
from django.urls import reverse
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

from agents_app.fleet import get_fleet
from tests.admin.conftest import with_a_past
from tests.admin.test_ownership import addresses
from tests.agents.makers import make_agent, make_user

pytestmark = [pytest.mark.browser, pytest.mark.django_db(transaction=True)]

NO_PAGES = (
    "/curve/",
    "/live/",
    ".csv",
    ".zip",
    "/jsi18n/",
    "/autocomplete/",
    "/logout/",
    "/r/",
    "/keys/",
    "/do/restart/",
)


@pytest.fixture(autouse=True)
def fleet(settings):
    """Nothing runs."""
    settings.SHEPHERD_FLEET = "tests.agents.makers.RecordingFleet"
    get_fleet.cache_clear()
    yield
    get_fleet.cache_clear()


@pytest.fixture
def inside(browser, live_server):
    """Logged in as a superuser."""
    make_user("boss", password="secret-password", is_staff=True, is_superuser=True)
    browser.get(f"{live_server.url}/admin/login/")
    browser.find_element(By.NAME, "username").send_keys("boss")
    browser.find_element(By.NAME, "password").send_keys("secret-password")
    browser.find_element(By.CSS_SELECTOR, "[type=submit]").click()
    WebDriverWait(browser, 30).until(lambda driver: "/login/" not in driver.current_url)
    return browser


def test_no_page_of_the_admin_breaks_the_policy(inside, live_server, complaints):
    agent = with_a_past(make_agent("sheepdog", "boss"))
    pages = [page for page in addresses(agent) if not any(part in page for part in NO_PAGES)]
    assert len(pages) > 40
    for page in pages:
        inside.get(live_server.url + page)
        said = [line for line in complaints() if "Content Security Policy" in line or "Refused" in line]
        assert said == [], page


def test_the_page_of_the_api_works_under_the_policy(browser, live_server, complaints):
    browser.get(f"{live_server.url}/api/docs/")
    WebDriverWait(browser, 30).until(lambda driver: driver.find_elements(By.CSS_SELECTOR, ".opblock"))
    assert complaints() == []


def test_an_inline_script_does_not_run(inside, live_server, complaints):
    script = (
        "const s = document.createElement('script'); s.textContent = 'window.smuggled = 1'; document.body.append(s)"
    )
    for page in (reverse("admin:agents_app_agent_changelist"), "/api/docs/"):
        inside.get(live_server.url + page)
        inside.execute_script(script)
        assert inside.execute_script("return window.smuggled") is None
        assert any("Content Security Policy" in line for line in complaints())
