"""Bored in the city in a real browser, with a real server and a real agent, and no other host to ask."""

from __future__ import annotations

import json
import shutil
import socket
import tempfile
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from selenium import webdriver

from tests.browser.bored_page import DESK, HERE, Visitor
from tests.browser.conftest import running_browser
from tests.clients.driving import PROJECT
from tests.servers import Server, running_server, wait_for

pytestmark = pytest.mark.browser

AXE = PROJECT / "frontend" / "bored" / "node_modules" / "axe-core" / "axe.min.js"
STANDARDS = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
FIRST_VIEW = 300_000  # bytes
OFFLINE = {"SHEPHERD_BORED_TILES": "", "SHEPHERD_BORED_ROUTING": ""}


@pytest.fixture(scope="module")
def city() -> Iterator[Server]:
    """A server that asks nobody, on a port that it takes again when it is started anew."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    data = Path(tempfile.mkdtemp(prefix="bored-"))
    with running_server(data, PORT=port, **OFFLINE) as server:
        yield server
    shutil.rmtree(data, ignore_errors=True)


@pytest.fixture(scope="module")
def owners_key(city: Server) -> str:
    """The owner's key of the agent, which the page finds by its name."""
    spaces = ("--action-space=179", "--observation-space=[[29], -1, 1]", "--set=sessions_per_execution=100")
    made = city.manage(
        "create_agent",
        "--owner=bored",
        "--name=Bored in the city",
        "--algorithm=PPO",
        "--set=action_masks=true",
        "--publishable",
        *spaces,
    )
    return json.loads(made)["api_key"]


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[webdriver.Chrome]:
    """One for all tests here; each begins with one that has forgotten everything."""
    with running_browser(tmp_path_factory.mktemp("browser")) as chrome:
        yield chrome


@pytest.fixture
def visitor(browser: webdriver.Chrome, city: Server, owners_key: str) -> Visitor:
    """Somebody with a phone, who has never been here and does not say where they are."""
    return Visitor(browser, city.url).is_new().holds().is_at(None)


@pytest.fixture(autouse=True)
def quiet(visitor, complaints, hosts, request) -> Iterator[None]:
    """No test leaves an error on the console or asks another host."""
    yield
    assert hosts() <= {visitor.url.split("/")[2]}
    if not request.node.get_closest_marker("away"):
        assert complaints() == []


def answers(city: Server, owners_key: str) -> list[float]:
    """What the agent was rewarded with, suggestion by suggestion."""
    headers = {"Authorization": f"Bearer {owners_key}"}
    table = httpx.get(f"{city.url}api/v1/agent/returns?format=csv", headers=headers).raise_for_status().text
    return [float(line.split(",")[3]) for line in table.splitlines()[1:]]


def test_the_first_visit_is_light_and_a_place_is_loved(visitor, city, owners_key):
    visitor.command("Network.enable")
    visitor.opens()
    visitor.sees("#panel h2", "Bored in Brussels?")
    loaded = "performance.getEntriesByType('resource').reduce((sum, one) => sum + one.encodedBodySize, 0)"
    page = "performance.getEntriesByType('navigation')[0].encodedBodySize"
    assert visitor.browser.execute_script(f"return {loaded} + {page}") < FIRST_VIEW

    name = visitor.asks_for_a_place()
    assert "1000 Bruxelles" in visitor.sees("#panel address")
    assert "min walk" in visitor.sees("#panel .facts")
    assert visitor.has(".pin.large")
    before = len(answers(city, owners_key))
    visitor.presses("I love it, add to favorites")
    visitor.sees("#panel .loved", "Among your favorites")
    visitor.sees("#snack", f"{name} is a favorite")
    assert visitor.sees("#favourites-button .count") == "1"
    assert visitor.asks_for_a_place() != name
    assert not visitor.has("#snack .snack"), "whoever goes on cannot take it back"
    wait_for(lambda: len(answers(city, owners_key)) == before + 1)
    assert answers(city, owners_key)[-1] == 1


def test_why_it_was_suggested_is_said(visitor):
    visitor.opens().asks_for_a_place()
    visitor.presses("Why this place?")
    because = visitor.sees("#panel .why[open]")
    assert "learned from all visitors" in because
    assert "from where suggestions start" in because
    assert "You have no favorites of this kind yet." in because


def test_without_a_position_the_grand_place_stands_for_it_and_then_the_last_favourite(visitor):
    visitor.opens()
    visitor.presses("Use my location")
    visitor.sees("#snack", "Your location is not available")
    visitor.asks_for_a_place()
    assert (
        visitor.memory()["current"]["reason"] | {"here": [50.8467, 4.3525], "located": False}
        == (visitor.memory()["current"]["reason"])
    )
    visitor.presses("I love it, add to favorites").asks_for_a_place()
    loved = visitor.memory()["favourites"][0]
    place = next(one for one in places() if one["id"] == loved)
    assert visitor.memory()["current"]["reason"]["here"] == [place["lat"], place["lon"]]


def test_with_a_position_the_way_begins_there(visitor):
    visitor.is_at(HERE).opens()
    visitor.presses("Use my location")
    visitor.wait(lambda: visitor.memory()["locate"])
    visitor.asks_for_a_place()
    reason = visitor.memory()["current"]["reason"]
    assert (reason["here"], reason["located"]) == ([HERE["latitude"], HERE["longitude"]], True)
    assert visitor.has(".here:not(.assumed)")
    visitor.opens()  # the next day it is not asked again
    visitor.wait(lambda: visitor.has(".here:not(.assumed)"))


def test_directions_without_a_network_are_a_straight_line_with_an_estimate(visitor):
    visitor.opens().asks_for_a_place()
    visitor.presses("Show directions")
    words = visitor.sees("#panel .way-words", "on foot")
    assert "estimates" in words
    assert visitor.has("path.way.estimated")
    assert "openstreetmap.org/directions" in visitor.browser.find_element("css selector", ".way-words a").get_attribute(
        "href"
    )
    visitor.presses("Hide directions")
    visitor.wait(lambda: not visitor.has("path.way"))


def test_favourites_are_shown_opened_removed_and_brought_back(visitor):
    visitor.opens()
    names = []
    for _ in range(3):
        names.append(visitor.asks_for_a_place())
        visitor.presses("I love it, add to favorites")
    visitor.presses("Show favorites 3")
    visitor.sees("#panel h2", "Your favorites")
    rows = [row.text for row in visitor.browser.find_elements("css selector", ".rows strong")]
    assert rows == names[::-1]
    visitor.wait(lambda: len(visitor.browser.find_elements("css selector", ".pin")) == 3)
    visitor.presses(f"Remove {names[0]}")
    visitor.wait(lambda: len(visitor.browser.find_elements("css selector", ".rows li")) == 2)
    visitor.presses("Undo")
    visitor.wait(lambda: len(visitor.browser.find_elements("css selector", ".rows li")) == 3)
    visitor.presses(names[1], within=".rows")
    visitor.sees("#panel h2", names[1])
    visitor.presses("Back")
    visitor.presses("Hide favorites 3")
    visitor.sees("#panel .loved")


def test_a_dismissal_can_be_taken_back_before_the_agent_hears_of_it(visitor, city, owners_key):
    visitor.opens()
    before = len(answers(city, owners_key))
    first = visitor.asks_for_a_place()
    visitor.presses("Not for me")
    visitor.wait(lambda: visitor.place() != first)
    second = visitor.place()
    visitor.presses("Undo")
    visitor.sees("#panel h2", first)
    visitor.presses("I love it, add to favorites")
    visitor.presses("Next place")
    visitor.sees("#panel h2", second)
    visitor.presses("Not for me")
    visitor.wait(lambda: visitor.place() != second)
    visitor.wait(lambda: not visitor.has("#snack .snack"))  # too late to take back
    wait_for(lambda: len(answers(city, owners_key)) == before + 2)
    assert answers(city, owners_key)[before:] == [1, 0]


def test_a_card_is_swiped_to_the_side(visitor):
    first = visitor.opens().asks_for_a_place()
    swipe(visitor, -200)
    visitor.wait(lambda: visitor.place() != first)
    second = visitor.place()
    swipe(visitor, 40)  # not far enough: nothing happens
    assert visitor.place() == second
    swipe(visitor, 200)
    visitor.sees("#snack", f"{second} is a favorite")


def test_a_reload_changes_nothing(visitor, city, owners_key):
    before = len(answers(city, owners_key))
    loved = visitor.opens().asks_for_a_place()
    visitor.presses("I love it, add to favorites")
    visitor.opens()  # the answer had not been sent
    assert visitor.sees("#panel h2") == loved
    wait_for(lambda: len(answers(city, owners_key)) == before + 1)
    name = visitor.asks_for_a_place()
    visitor.opens()
    assert visitor.place() == name


def test_it_opens_without_a_network_and_chance_decides(visitor, complaints, hosts, city):
    visitor.opens()
    visitor.asks_for_a_place()
    visitor.presses("I love it, add to favorites")
    visitor.browser.execute_async_script("navigator.serviceWorker.ready.then(arguments[0])")
    visitor.wait(lambda: visitor.browser.execute_script("return caches.match('js/views/menu.js').then(Boolean)"))
    visitor.goes_offline().opens()
    visitor.sees("#panel .loved")
    visitor.presses("Next place")
    visitor.sees("#panel .notice", "The guide cannot be reached")
    assert visitor.memory()["current"]["session"] is None
    visitor.presses("Show directions").sees("#panel .way-words", "on foot")
    visitor.presses("Show favorites 1")
    visitor.sees("#panel .rows")
    complaints()  # the browser complains that there is no network
    visitor.goes_offline(False).opens()
    visitor.presses("Not for me")
    visitor.wait(lambda: visitor.memory()["current"]["session"])


def test_two_visitors_do_not_meet(visitor, tmp_path):
    first = visitor.opens().asks_for_a_place()
    visitor.presses("I love it, add to favorites")
    mine = visitor.memory()
    with running_browser(tmp_path / "other") as phone:
        other = Visitor(phone, visitor.url).holds().opens()
        other.sees("#panel h2", "Bored in Brussels?")
        other.asks_for_a_place()
        assert {seat["key"] for seat in other.memory()["seats"]}.isdisjoint(seat["key"] for seat in mine["seats"])
        other.presses("Not for me")
    assert visitor.sees("#panel h2") == first
    visitor.asks_for_a_place()


@pytest.mark.parametrize(
    ("languages", "tag", "title", "next_place", "address"),
    [
        ("fr-BE,fr", "fr", "On s’ennuie à Bruxelles ?", "Lieu suivant", "1000 Bruxelles"),
        ("nl-BE,nl", "nl", "Verveel je je in Brussel?", "Volgende plek", "1000 Brussel"),
    ],
)
def test_it_speaks_the_visitors_language(visitor, languages, tag, title, next_place, address):
    visitor.holds(languages=languages).opens()
    visitor.sees("#panel h2", title)
    assert visitor.browser.execute_script("return document.documentElement.lang") == tag
    visitor.presses(next_place)
    visitor.sees("#panel address", address)
    visitor.presses("Menu").presses("English", within="dialog")
    visitor.sees("#panel .actions", "I love it")
    visitor.opens().sees("#favourites-button", "Show favorites")  # that choice is kept


def test_a_link_opens_a_place_and_forgetting_leaves_nothing(visitor, city):
    visitor.opens("#place/manneken-pis")
    visitor.sees("#panel h2", "Manneken Pis")
    visitor.presses("Add to favorites")
    visitor.sees("#favourites-button .count", "1")
    visitor.opens().asks_for_a_place()
    session = visitor.memory()["seats"][0]["key"]
    visitor.presses("Menu").presses("Privacy", within="dialog")
    assert "this page asks no other server" in visitor.sees("#panel .prose")
    visitor.presses("Forget me").sees("#panel .forgetting", "Deletes your favorites")
    visitor.presses("Forget me")
    visitor.sees("#snack", "Nothing of you is left")
    assert visitor.memory().get("favourites", []) == visitor.memory().get("seats", []) == []
    left = httpx.post(
        f"{city.url}api/v1/step",
        headers={"Authorization": f"Bearer {session}", "Origin": city.url.rstrip("/")},
        json={"obs": [0] * 29, "reward": 0, "terminated": False, "truncated": False},
    )
    assert left.json()["code"] == "unknown_session"


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("size", [None, DESK], ids=["phone", "desk"])
def test_everybody_can_use_it(visitor, dark, size):
    if not AXE.exists():
        pytest.skip("axe-core is not installed: npm install, in frontend/bored")
    visitor.holds(*([size] if size else []), dark=dark).opens("#place/manneken-pis")
    visitor.presses("Add to favorites")
    visitor.presses("Show directions").sees("#panel .way-words", "on foot")
    check(visitor, "a place")
    visitor.opens()
    check(visitor, "the welcome")
    visitor.asks_for_a_place()
    visitor.presses("Why this place?")
    check(visitor, "a suggestion")
    visitor.presses("I love it, add to favorites").sees("#panel .loved")
    check(visitor, "a loved one")
    visitor.presses("Show favorites 2").sees("#panel .rows")
    check(visitor, "favourites")
    visitor.presses("Menu").sees("dialog[open]")
    check(visitor, "the menu")
    visitor.presses("Privacy", within="dialog").sees("#panel .prose")
    check(visitor, "privacy")


def test_all_of_it_works_with_the_keyboard(visitor):
    visitor.holds(DESK).opens()
    press(visitor, "Tab")
    assert focus(visitor) == "Skip to the suggestion"
    press(visitor, "Enter")
    for expected in ("Next place", "Use my location"):
        press(visitor, "Tab")
        assert focus(visitor) == expected
    visitor.browser.find_element("css selector", ".primary").send_keys("\n")
    name = visitor.place()
    assert focus(visitor) == name, "the keyboard is at the new place"
    assert visitor.browser.find_element("css selector", "#told").get_attribute("textContent").startswith("Suggested")


@pytest.mark.away
def test_the_server_goes_away_and_comes_back(visitor, city, owners_key):
    visitor.opens()
    visitor.asks_for_a_place()
    visitor.presses("I love it, add to favorites")
    port, before = city.url.split(":")[2].strip("/"), len(answers(city, owners_key))
    city.stop()
    visitor.presses("Next place")
    visitor.sees("#panel .notice", "The guide cannot be reached")
    visitor.presses("Not for me").sees("#panel .notice")
    with running_server(city.data, PORT=port, **OFFLINE) as again:
        visitor.presses("Not for me")
        visitor.wait(lambda: visitor.memory()["current"]["session"])
        wait_for(lambda: len(answers(again, owners_key)) == before + 1)
        assert answers(again, owners_key)[-1] == 1


def places() -> list[dict]:
    """All places."""
    return json.loads((PROJECT / "frontend" / "bored" / "places.json").read_text(encoding="utf-8"))["places"]


def swipe(visitor: Visitor, across: int) -> None:
    """A finger on the card."""
    y = visitor.browser.execute_script("return document.querySelector('#panel h2').getBoundingClientRect().top + 10")
    touches = [("touchStart", [{"x": 195, "y": y}])]
    touches += [("touchMove", [{"x": 195 + across * part / 8, "y": y}]) for part in range(1, 9)]
    for kind, points in [*touches, ("touchEnd", [])]:
        visitor.command("Input.dispatchTouchEvent", type=kind, touchPoints=points)


def check(visitor: Visitor, where: str) -> None:
    """That axe finds nothing."""
    visitor.browser.execute_script(AXE.read_text(encoding="utf-8"))
    script = "axe.run(document, {runOnly: arguments[0]}).then(({violations}) => arguments[1](violations))"
    found = visitor.browser.execute_async_script(script, STANDARDS)
    assert [(one["id"], [node["html"][:200] for node in one["nodes"]]) for one in found] == [], where


def press(visitor: Visitor, key: str) -> None:
    """A key."""
    text = {"Enter": "\r"}.get(key, "")
    for kind in ("keyDown", "keyUp"):
        code = {"Tab": 9, "Enter": 13}[key]
        visitor.command("Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=code, text=text)


def focus(visitor: Visitor) -> str:
    """The text of what has the keyboard."""
    return visitor.browser.execute_script("return document.activeElement.innerText.trim()")
