"""The agent's page in a real browser: alive without reloading, quiet on the console, asking no foreign host."""

import math

import pytest
from django.urls import reverse
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select, WebDriverWait

from agents_app.fleet import get_fleet
from agents_app.models import EpisodeReturn, ExecutionError
from tests.agents.makers import RecordingFleet, make_agent, make_user

pytestmark = [pytest.mark.browser, pytest.mark.django_db(transaction=True)]


@pytest.fixture(autouse=True)
def fleet(settings):
    """Executions to look at."""
    settings.SHEPHERD_FLEET = "tests.agents.makers.RecordingFleet"
    RecordingFleet.calls, RecordingFleet.unreachable, RecordingFleet.statuses = [], False, []
    get_fleet.cache_clear()
    yield RecordingFleet
    get_fleet.cache_clear()


@pytest.fixture
def agent():
    boss = make_user("boss", password="secret-password", is_staff=True, is_superuser=True)
    return make_agent("sheepdog", boss)


@pytest.fixture
def page(browser, live_server, agent):
    """The agent's page, logged in; waits are for what is seen, not for time."""
    address = reverse("admin:agents_app_agent_change", args=[agent.pk])
    browser.get(f"{live_server.url}/admin/login/?next={address}")
    browser.find_element(By.NAME, "username").send_keys("boss")
    browser.find_element(By.NAME, "password").send_keys("secret-password")
    browser.find_element(By.CSS_SELECTOR, "[type=submit]").click()
    wait_for(browser, lambda: browser.find_element(By.ID, "shepherd-live"))
    return browser


def wait_for(browser, condition):
    return WebDriverWait(browser, 30, ignored_exceptions=[Exception]).until(lambda _: condition())


def add_returns(agent, count, executions=2):
    run = agent.current_run()
    known = [run.executions.get_or_create(number=number)[0] for number in range(1, executions + 1)]
    first = EpisodeReturn.objects.filter(run=run).count()
    EpisodeReturn.objects.bulk_create(
        EpisodeReturn(
            run=run, execution=known[i % executions], episode=i, length=9, value=500 - 480 * math.exp(-i / 80) + i % 7
        )
        for i in range(first, first + count)
    )


def click(page, css):
    """In the middle of the window: the bar with the form's buttons covers what lies at its lower edge."""
    element = page.find_element(By.CSS_SELECTOR, css)
    page.execute_script("arguments[0].scrollIntoView({block: 'center'})", element)
    element.click()


def part(page, name):
    return page.find_element(By.CSS_SELECTOR, f'[data-part="{name}"]')


def test_the_page_is_alive(page, agent, fleet, complaints, hosts, live_server):
    wait_for(page, lambda: "No episode has ended yet" in part(page, "chart").text)
    assert "No execution is running" in part(page, "advice-words").text
    page.execute_script("window.notReloaded = true")

    add_returns(agent, 300)
    fleet.statuses = [
        {
            "number": 1,
            "state": "acting",
            "steps": 12345,
            "steps_per_second": 321.5,
            "memory": 14_000_000,
            "advisors": [2],
        },
        {"number": 2, "state": "waiting", "steps": 7, "memory": 12_000_000, "advises": [1]},
    ]
    wait_for(page, lambda: part(page, "summary").text.startswith("300 episodes"))
    wait_for(page, lambda: len(part(page, "executions").find_elements(By.CSS_SELECTOR, "tbody tr")) == 2)
    assert "12,345" in part(page, "executions").text
    assert part(page, "advice-words").text == "1 of 2 pairs of executions advise."
    assert len(page.find_elements(By.CSS_SELECTOR, ".sh-advice .arrow")) == 1

    add_returns(agent, 50)
    wait_for(page, lambda: part(page, "summary").text.startswith("350 episodes"))

    run = agent.current_run()
    ExecutionError.objects.create(
        run=run,
        execution_uid=run.executions.first().uid,
        summary="ValueError: <b>wrong</b>",
        traceback="Traceback: line 1",
    )
    wait_for(page, lambda: "ValueError: <b>wrong</b>" in part(page, "errors").text)
    click(page, '[data-part="errors"] summary')
    assert "Traceback: line 1" in part(page, "errors").text

    Select(part(page, "by")).select_by_value("execution")
    wait_for(page, lambda: "execution 2" in part(page, "legend").text)
    assert page.execute_script("return window.notReloaded")
    assert page.execute_script("const c = document.querySelector('.sh-chart canvas'); return c.width * c.height") > 1000
    assert complaints() == []
    assert hosts() == {live_server.url.removeprefix("http://")}


def test_a_key_is_made_and_revoked(page, agent):
    part_of_form = page.find_element(By.CSS_SELECTOR, "#shepherd-live input[name=name]")
    part_of_form.send_keys("lab")
    click(page, "#shepherd-live .sh-primary")
    secret = wait_for(page, lambda: page.find_element(By.ID, "secret").text)
    assert secret.startswith("sk_")
    page.find_element(By.LINK_TEXT, "I have it, back to the agent").click()
    wait_for(page, lambda: page.find_element(By.PARTIAL_LINK_TEXT, "Revoke")).click()
    wait_for(page, lambda: page.find_element(By.CSS_SELECTOR, ".sh-danger")).click()
    wait_for(page, lambda: "opens nothing any more" in page.find_element(By.TAG_NAME, "body").text)
    assert not agent.api_keys.get().is_valid()


def shown_settings(page):
    """The settings of advice whose condition holds, whichever tab is open."""
    rows = page.find_elements(By.CSS_SELECTOR, '[x-show*="advice_method"]')
    visible = [row for row in rows if row.value_of_css_property("display") != "none"]
    named = [row.find_element(By.CSS_SELECTOR, "[name]").get_attribute("name") for row in visible]
    return set(named)


def test_the_settings_of_advice_show_what_the_method_asks(page, agent, complaints):
    method = page.find_element(By.NAME, "advice_method")

    def choose(name):
        script = "arguments[0].value = arguments[1]; arguments[0].dispatchEvent(new Event('change', {bubbles: true}))"
        page.execute_script(script, method, name)

    always = {"advisors", "peers_advise", "advisor", "advisor_save", "advice_form", "rho"}
    wait_for(page, lambda: shown_settings(page) == always | {"last_word", "learning_correction"})
    for name, asked in [
        ("reuse", always | {"psi", "learning_correction"}),
        ("shaping", always | {"shaping_scale"}),
        ("geometric", always | {"advice_weight", "learning_correction"}),
        ("none", set()),
        ("union", always | {"learning_correction"}),
    ]:
        choose(name)
        wait_for(page, lambda expected=asked: shown_settings(page) == expected)
    before = {field.name: getattr(agent, field.name) for field in agent._meta.fields}
    page.find_element(By.NAME, "_continue").click()
    wait_for(page, lambda: type(agent).objects.get(pk=agent.pk).advice_method == "union")
    agent.refresh_from_db()
    after = {field.name: getattr(agent, field.name) for field in agent._meta.fields}
    assert {name for name in before if before[name] != after[name]} == {"advice_method"}
    assert complaints() == []
