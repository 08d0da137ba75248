"""`make screenshots`: pictures of the web pages for the README, from a real server and a real browser."""

from __future__ import annotations

import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import gymnasium
import shepherd_client

from tests.browser.bored_page import DESK, PHONE, Visitor
from tests.browser.conftest import running_browser
from tests.browser.visits import PLACES, visit
from tests.servers import PROJECT, Server, running_server

TARGET = PROJECT / "docs" / "screenshots"
HERE = {"latitude": 50.8491, "longitude": 4.3541, "accuracy": 10}
OFFLINE = {"SHEPHERD_BORED_TILES": "", "SHEPHERD_BORED_ROUTING": ""}
CLIENTS, STEPS, SUGGESTIONS = 4, 5000, 600
TALL_DESK = (1280, 1180)
QUICK = {"n_steps": 128, "batch_size": 64, "gamma": 0.98, "gae_lambda": 0.9, "learning_rate": 0.001}
# The visitors all came within this hour: the same again at others, more in the afternoon than at night.
WHOLE_DAY = """
from agents_app.models import ActionTally
for row in list(ActionTally.objects.all()):
    for hour in range(24):
        count = row.count * min(abs(hour - 4), abs(hour - 28)) // 6
        loved = min(count, round(row.total * count / row.count * (0.5 + min(abs(hour - 5), abs(hour - 29)) / 16)))
        ActionTally.objects.update_or_create(
            run=row.run, action=row.action, hour=hour, defaults={"count": count, "total": loved})
ActionTally.objects.filter(count=0).delete()
"""
LOVED = ["mok-specialty-coffee", "goupil-le-fol", "passa-porta-bookshop", "hong-hoa", "manneken-pis"]


def main() -> None:
    """Take them all anew."""
    TARGET.mkdir(parents=True, exist_ok=True)
    with running_server(**OFFLINE) as server, tempfile.TemporaryDirectory() as profile:
        server.manage("demo_data")
        with running_browser(Path(profile)) as browser:
            visitor = Visitor(browser, server.url)
            take(visitor)
            take_agents(visitor, server)


def take(visitor: Visitor) -> None:
    """A first visit, a suggestion, the way there, favourites; a phone and a desk; light and dark; three languages."""
    visitor.is_at(HERE).holds(PHONE).opens()
    photograph(visitor, "bored-welcome")
    visitor.presses("Use my location").wait(lambda: visitor.has(".here:not(.assumed)"))
    visitor.asks_for_a_place()
    visitor.presses("Show directions").sees(".way-words", "on foot")
    photograph(visitor, "bored-directions")
    visitor.holds(PHONE, dark=True, languages="fr-BE,fr").opens()
    photograph(visitor, "bored-dark")
    for place in LOVED:
        visitor.opens(f"#place/{place}").wait(lambda: visitor.has(".actions .love"))
        visitor.browser.find_element("css selector", ".actions .love").click()
        visitor.wait(lambda: not visitor.has(".actions .love"))
    visitor.holds(PHONE, languages="nl-BE,nl").opens("#favourites")
    photograph(visitor, "bored-favourites")
    visitor.holds(DESK, languages="en-GB").opens()
    photograph(visitor, "bored-desk")


def take_agents(visitor: Visitor, server: Server) -> None:
    """The live page of an agent with four executions that have learned, and that of Bored in the city after a busy day."""
    poles, key = server.create_agent(
        name="Cart Pole", public=True, parameters=QUICK, observation_space=((4,), -1000, 1000)
    )
    train(server.url, key)
    visitor.holds(TALL_DESK).browser.get(f"{server.url}agents/{poles}/")
    visitor.sees("[data-part='advice-words']", f"All {CLIENTS} executions")
    photograph(visitor, "agent-desk")
    visitor.holds(PHONE, dark=True).browser.refresh()
    visitor.sees("[data-part='advice-words']", f"All {CLIENTS} executions")
    photograph(visitor, "agent-dark")
    spaces = {"action_space": len(PLACES), "observation_space": ((29,), -1, 1)}
    city, key = server.create_agent(name="Bored in the city", public=True, counted_in="Europe/Brussels", **spaces)
    visit(server.url, key, SUGGESTIONS)
    server.manage("shell", "--verbosity=0", "--command", WHOLE_DAY)
    visitor.holds(PHONE).browser.get(f"{server.url}agents/{city}/")
    visitor.wait(lambda: visitor.has(".city path.share"))
    visitor.browser.execute_script("document.querySelector('.city').closest('section').scrollIntoView()")
    photograph(visitor, "agent-places")


def train(url: str, key: str) -> None:
    """Clients that play Cart Pole, all at once."""
    with ThreadPoolExecutor(CLIENTS) as pool:
        for played in [pool.submit(play, url, key, seed) for seed in range(CLIENTS)]:
            played.result()


def play(url: str, key: str, seed: int) -> None:
    """One of them."""
    shepherd_client.run(gymnasium.make("CartPole-v1"), key, steps=STEPS, progress=False, url=url, seed=seed)


def photograph(visitor: Visitor, name: str) -> None:
    """Once the map stands still."""
    visitor.wait(lambda: not visitor.has(".leaflet-zoom-anim, .leaflet-pan-anim, .waiting:not(.stand)"))
    visitor.photographs(TARGET / f"{name}.png")


if __name__ == "__main__":
    main()
