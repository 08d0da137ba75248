"""The live page of an agent: who may see it, and what it tells whom."""

from __future__ import annotations

import re
import uuid
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from threading import Event
from time import sleep

import pytest
from django.test import Client
from django.urls import reverse

from agents_app import tallies
from agents_app.models import APIKey
from frontend.sharing import KEPT, Recent
from tests.agents.makers import make_agent, make_staff, make_user
from tests.browser.visits import OBSERVATION, PLACES

pytestmark = pytest.mark.django_db

NAMES = ("agent", "agent-curve", "agent-executions", "agent-actions")
STATUS = {
    "uid": "secret-uid",
    "number": 1,
    "run": 99,
    "agent": "secret-agent",
    "pid": 4242,
    "state": "acting",
    "sessions": 1,
    "active_sessions": [77],
    "steps": 12,
    "steps_per_second": 3.5,
    "memory": 14_000_000,
    "cpu_percent": 50.0,
    "save_error": "no room at /secret/path",
    "advisors": [2, "wolfhound"],
    "advises": [2],
}


@pytest.fixture
def stranger():
    """A browser that nobody has logged in with."""
    return Client()


@pytest.fixture(autouse=True)
def _seconds_pass(monkeypatch):
    """So that nothing is shared that is not meant to be."""
    seconds = count(0.0, 10.0)
    monkeypatch.setattr("frontend.sharing.monotonic", lambda: next(seconds))


@pytest.fixture
def clock(_seconds_pass, monkeypatch):
    """The clock of what strangers share, which a test winds."""
    at = [1000.0]
    monkeypatch.setattr("frontend.sharing.monotonic", lambda: at[0])
    return at


def pages(of):
    return [reverse(name, args=[of.pk]) for name in NAMES]


def publish(which, **fields):
    for name, value in ({"public": True} | fields).items():
        setattr(which, name, value)
    which.save()
    return which


def test_the_owner_sees_a_page_that_is_not_public(client, agent):
    for address in pages(agent):
        assert client.get(address).status_code == 200, address
    page = client.get(reverse("agent", args=[agent.pk])).content.decode()
    assert "sheepdog" in page
    assert "Only you see this page." in page
    assert reverse("admin:agents_app_agent_change", args=[agent.pk]) in page


@pytest.mark.parametrize("who", ["stranger", "other user", "other staff", "an owner who was deactivated"])
def test_nobody_else_can_tell_that_there_is_an_agent(who, agent, ann):
    browser = Client()
    if who == "other user":
        browser.force_login(make_user("client"))
    elif who == "other staff":
        browser.force_login(make_staff("carl"))
    elif who == "an owner who was deactivated":
        browser.force_login(ann)
        ann.is_active = False
        ann.save()
    nobodys = make_agent("gone", ann)
    addresses = [*pages(agent), *pages(nobodys)]
    nobodys.delete()
    answers = {(answer.status_code, answer.content) for answer in map(browser.get, addresses)}
    assert {status for status, _ in answers} == {404}
    assert len(answers) == 1


def test_an_owner_without_staff_sees_it_too():
    owner = make_user("client")
    browser = Client()
    browser.force_login(owner)
    page = browser.get(reverse("agent", args=[make_agent("lamb", owner).pk]))
    assert page.status_code == 200
    assert b"/admin/" not in page.content


def test_superusers_see_all(boss, agent):
    assert {boss.get(address).status_code for address in pages(agent)} == {200}


def test_a_public_page_tells_no_secret(stranger, agent, fleet):
    publish(agent, counted_in="UTC")
    fleet.statuses = [STATUS]
    told = b"".join(stranger.get(address).content for address in pages(agent)).decode()
    assert "sheepdog" in told
    key = APIKey.issue(agent, publishable=True)[1]
    told = re.sub(r"[0-9a-f-]{36}", "", told)
    for secret in (
        key,
        "sk_",
        "pk_",
        "error of",
        "trace of",
        "key of",
        "save of",
        "admin",
        "wolfhound",
        "secret",
        "4242",
        "77",
    ):
        assert secret not in told, secret
    assert not re.search(r"\bann\b", told)
    [execution] = stranger.get(reverse("agent-executions", args=[agent.pk])).json()["executions"]
    assert execution["advisors"] == [2, "another agent"]
    assert set(execution) == {"number", "state", "sessions", "steps", "steps_per_second", "advises", "advisors"}


def test_strangers_who_ask_at_once_cost_one_question(stranger, client, agent, fleet, clock):
    address = reverse("agent-executions", args=[publish(agent).pk])
    first = [stranger.get(address).json() for _ in range(3)]
    assert first == [first[0]] * 3
    assert len(fleet.calls) == 1
    client.get(address)
    assert len(fleet.calls) == 2
    clock[0] += 1.0
    stranger.get(address)
    assert len(fleet.calls) == 3


def test_strangers_who_ask_while_an_answer_is_made_wait_for_it(clock):
    recent, made, begun, goes_on = Recent(), [], Event(), Event()

    def make():
        made.append("once")
        begun.set()
        goes_on.wait(10)
        return "told"

    with ThreadPoolExecutor(8) as pool:
        first = pool.submit(recent.get, "curve", make)
        begun.wait(10)
        others = [pool.submit(recent.get, "curve", make) for _ in range(7)]
        sleep(0.1)
        goes_on.set()
        assert {each.result() for each in [first, *others]} == {"told"}
    assert made == ["once"]


def test_an_answer_that_failed_is_not_kept(clock):
    recent = Recent()
    with pytest.raises(ZeroDivisionError):
        recent.get("curve", lambda: 1 // 0)
    assert recent.get("curve", lambda: "told") == "told"


def test_what_an_address_says_beside_the_question_makes_no_new_answer(stranger, agent, fleet, clock):
    address = reverse("agent-executions", args=[publish(agent).pk])
    for number in range(3):
        stranger.get(address, {"nonsense": number})
    assert len(fleet.calls) == 1


def test_what_strangers_share_is_of_one_agent_and_one_question(stranger, agent, foreign, clock):
    addresses = [reverse("agent-curve", args=[publish(each).pk]) for each in (agent, foreign)]
    values = [stranger.get(address).json()["lines"][0]["value"] for address in addresses]
    assert values == [[7.5], [123.25]]
    assert stranger.get(addresses[0], {"by": "execution"}).json()["lines"][0]["name"] == "execution 1"


def test_an_agent_that_is_public_no_more_is_gone_at_once(stranger, agent, clock):
    address = reverse("agent-curve", args=[publish(agent).pk])
    assert stranger.get(address).status_code == 200
    publish(agent, public=False)
    assert stranger.get(address).status_code == 404


def test_no_more_answers_are_kept_than_there_is_room_for(clock):
    recent, made = Recent(), []
    for key in [*range(KEPT), 0, KEPT, 1, 0]:
        recent.get(key, lambda key=key: made.append(key))
    assert made == [*range(KEPT), KEPT, 0]


def test_the_owner_reads_who_advises(client, agent, fleet):
    fleet.statuses = [STATUS]
    [execution] = client.get(reverse("agent-executions", args=[agent.pk])).json()["executions"]
    assert execution["advisors"] == [2, "wolfhound"]


def test_why_the_executions_cannot_be_reached_stays_inside(stranger, agent, fleet):
    fleet.unreachable = True
    answer = stranger.get(reverse("agent-executions", args=[publish(agent).pk])).json()
    assert answer == {"executions": [], "notice": "The executions cannot be reached just now."}


def test_the_curve_is_read_run_by_run(stranger, agent):
    address = reverse("agent-curve", args=[publish(agent).pk])
    curve = stranger.get(address).json()
    assert curve["lines"][0]["value"] == [7.5]
    assert stranger.get(address, {"version": curve["version"]}).json() == {"unchanged": True}
    assert stranger.get(address, {"by": "execution"}).json()["lines"][0]["name"] == "execution 1"
    agent.runs.create(number=2)
    assert stranger.get(address).json()["lines"][0]["value"] == []
    assert stranger.get(address, {"run": 1}).json()["lines"][0]["value"] == [7.5]


@pytest.mark.parametrize("run", ["3", "0", "-1", "x", "٣", "1" * 40, "1.0"])
def test_a_run_that_is_none_is_not_found(stranger, agent, run):
    for address in pages(publish(agent)):
        if "executions" not in address:
            assert stranger.get(address, {"run": run}).status_code == 404, address


def test_what_is_counted_is_read_and_asked_for_again_only_when_it_changes(stranger, agent):
    publish(agent, counted_in="UTC")
    address = reverse("agent-actions", args=[agent.pk])
    assert stranger.get(address, {"version": -1}).json() == {"version": 0, "rows": []}
    tallies.count(agent.current_run().pk, "UTC", 2, 3600.0 * 5, 1.0)
    assert stranger.get(address, {"version": 0}).json() == {"version": 1, "rows": [[2, 5, 1, 1.0]]}
    assert stranger.get(address, {"version": 1}).json() == {"unchanged": True}
    assert b'data-part="actions"' in stranger.get(reverse("agent", args=[agent.pk])).content


def test_actions_that_are_not_counted_have_no_place_on_the_page(stranger, agent):
    assert b'data-part="actions"' not in stranger.get(reverse("agent", args=[publish(agent).pk])).content


def test_an_agent_of_bored_in_the_city_has_places(stranger):
    spaces = {"action_space": len(PLACES), "observation_space": [[len(OBSERVATION)], -1, 1]}
    for fields, has_places in [(spaces, True), (spaces | {"action_space": 5}, False)]:
        made = make_agent(f"agent {has_places}", public=True, counted_in="Europe/Brussels", **fields)
        assert (b'data-part="city"' in stranger.get(reverse("agent", args=[made.pk])).content) is has_places


def test_only_reading_is_allowed_and_no_cache_keeps_it(stranger, agent):
    for address in pages(publish(agent)):
        assert stranger.post(address).status_code == 405
        assert "no-store" in stranger.get(address)["Cache-Control"]


def test_the_policy_of_the_page_is_the_strict_one(stranger, agent):
    policy = stranger.get(reverse("agent", args=[publish(agent).pk]))["Content-Security-Policy"]
    assert "default-src 'self'" in policy
    assert "unsafe" not in policy
    assert "script-src" not in policy


def test_its_files_are_served_and_its_tools_are_not(stranger):
    assert b"".join(stranger.get("/agents/js/main.js").streaming_content).startswith(b"// @ts-check")
    tools = ("package.json", "tsconfig.json", "test/tally.test.js", "js/../package.json")
    for file in (*tools, "js/none.js", "", str(uuid.uuid4())):
        assert stranger.get(f"/agents/{file}").status_code == 404, file


def test_bored_in_the_city_links_to_the_page_once_it_is_public(stranger):
    made = make_agent("Bored in the city")
    APIKey.issue(made, publishable=True)
    assert stranger.get("/bored/config.json").json()["live"] is None
    publish(made)
    assert stranger.get("/bored/config.json").json()["live"] == reverse("agent", args=[made.pk])
