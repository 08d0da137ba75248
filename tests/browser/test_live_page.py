"""The live page of an agent in a real browser, with a real server, and executions that advise each other."""

from __future__ import annotations

from collections.abc import Iterator

import httpx
import pytest
from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select

from tests.browser.bored_page import DESK, PHONE, Visitor
from tests.browser.conftest import running_browser
from tests.browser.test_bored import AXE, check, focus, press
from tests.browser.visits import OBSERVATION, PLACES, visit
from tests.servers import Server

pytestmark = pytest.mark.browser

SESSIONS, SUGGESTIONS = 3, 120
MOST_PLACES_ARE_SEEN = """
    const map = document.querySelector(".city").getBoundingClientRect();
    const places = [...document.querySelectorAll(".city path.share")].map((place) => place.getBoundingClientRect());
    const seen = places.filter(({x, y}) => x > map.left && x < map.right && y > map.top && y < map.bottom);
    return seen.length > 0.75 * places.length;
"""
SMALL = {"n_steps": 16, "batch_size": 16, "n_epochs": 1}


@pytest.fixture(scope="module")
def agent(server: Server) -> tuple[str, str]:
    """Id and key of a public agent of Bored in the city, which has three executions."""
    spaces = {"action_space": len(PLACES), "observation_space": ((len(OBSERVATION),), -1, 1)}
    return server.create_agent(parameters=SMALL, public=True, counted_in="Europe/Brussels", **spaces)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[webdriver.Chrome]:
    """One for all tests here."""
    with running_browser(tmp_path_factory.mktemp("browser")) as chrome:
        yield chrome


@pytest.fixture
def page(browser: webdriver.Chrome, server: Server, agent: tuple[str, str], complaints, hosts) -> Iterator[Visitor]:
    """A stranger with a phone, on the page, who has been shown what there is. Nothing is said on the console."""
    visitor = Visitor(browser, server.url).holds()
    browser.get(f"{server.url}agents/{agent[0]}/")
    visitor.sees("[data-part='advice-words']", "execution")
    visitor.wait(lambda: browser.find_element(By.CSS_SELECTOR, "[data-part='no-actions']").text != "Asking…")
    yield visitor
    assert hosts() == {server.url.split("/")[2]}
    assert complaints() == []


def count(page: Visitor, css: str) -> int:
    """How many such elements there are."""
    return len(page.browser.find_elements(By.CSS_SELECTOR, css))


def test_it_shows_what_happens_without_being_reloaded(page, server, agent):
    page.sees("[data-part='chart']", "No episode has ended yet")
    page.sees("[data-part='no-actions']", "Nothing is counted in this run yet")
    page.browser.execute_script("window.notReloaded = true")
    visit(server.url, agent[1], SUGGESTIONS, SESSIONS)

    page.wait(lambda: page.sees("[data-part='episodes']") == str(SUGGESTIONS))
    assert page.sees("[data-part='live']") == str(SESSIONS)
    page.sees("[data-part='advice-words']", f"All {SESSIONS} executions advise each other.")
    assert count(page, ".sh-advice .stand") == SESSIONS
    assert count(page, ".sh-advice .arrow") == SESSIONS * (SESSIONS - 1)
    rows = page.browser.find_elements(By.CSS_SELECTOR, "[data-part='executions'] tbody tr")
    assert sorted(row.text.split()[2] for row in rows) == ["1,", "1,", "2,"]  # advised by 2, 3; by 1, 3; by 1, 2
    page.sees("[data-part='counted']", f"{SUGGESTIONS} suggestions answered")
    assert page.browser.execute_script("return window.notReloaded")


def test_by_execution_the_curve_has_a_line_for_each(page):
    Select(page.browser.find_element(By.CSS_SELECTOR, "[data-part='by']")).select_by_value("execution")
    page.sees("[data-part='legend']", "execution 3")


def test_what_is_loved_is_shown_by_kind_by_hour_and_on_the_map(page):
    kinds = page.sees("[data-part='kinds']")
    assert "Café" in kinds
    assert "%" in kinds
    page.wait(lambda: count(page, ".city path.share") > 20)
    page.wait(lambda: page.browser.execute_script(MOST_PLACES_ARE_SEEN))
    assert count(page, "[data-part='hours'] li") == 24
    assert "Highest at" in page.sees("[data-part='peak']")
    assert count(page, "[data-part='most'] tr") == 12
    everything = spoken_hours(page)
    Select(page.browser.find_element(By.CSS_SELECTOR, "[data-part='kind']")).select_by_value("shop")
    page.wait(lambda: spoken_hours(page) != everything)
    assert sum(spoken_hours(page)) < sum(everything) == SUGGESTIONS


def spoken_hours(page: Visitor) -> list[int]:
    """Of how many suggestions the hours tell."""
    told = page.browser.execute_script(
        "return [...document.querySelectorAll('[data-part=hours] .unseen')].map((one) => one.textContent)"
    )
    return [int(text.rsplit(" ", 1)[1]) for text in told if "of" in text]


def test_the_keyboard_reads_single_episodes(page):
    for _ in range(20):
        press(page, "Tab")
        if "chart" in (page.browser.execute_script("return document.activeElement.dataset.part") or ""):
            break
    page.browser.switch_to.active_element.send_keys("\ue010")  # End
    page.sees("[data-part='legend']", f"Episode {SUGGESTIONS}. return ")
    page.browser.switch_to.active_element.send_keys("\ue011")  # Home
    page.sees("[data-part='legend']", "Episode 1. return ")
    page.browser.switch_to.active_element.send_keys("\ue014")  # right
    page.sees("[data-part='legend']", "Episode 2. return ")


def test_the_first_tab_skips_to_the_agent(page):
    press(page, "Tab")
    assert focus(page) == "Skip to the agent"


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("size", [PHONE, DESK])
def test_everybody_can_use_it(page, size, dark):
    if not AXE.exists():
        pytest.skip("axe-core is not installed: npm install, in frontend/bored")
    page.holds(size, dark=dark).browser.refresh()
    page.wait(lambda: count(page, ".city path.share") > 20)
    check(page, f"{size}, {dark=}")
    wider = "return document.documentElement.scrollWidth - document.documentElement.clientWidth"
    assert page.browser.execute_script(wider) == 0


def test_nothing_that_is_smuggled_in_runs(page, complaints):
    page.browser.execute_script(
        "const s = document.createElement('script'); s.textContent = 'window.smuggled = 1'; document.body.append(s)"
    )
    assert page.browser.execute_script("return window.smuggled") is None
    assert any("Content Security Policy" in line for line in complaints())


def test_an_agent_that_is_not_public_is_not_there(server):
    agent, _ = server.create_agent()
    assert httpx.get(f"{server.url}agents/{agent}/").status_code == 404
