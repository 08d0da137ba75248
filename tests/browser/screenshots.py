"""`make screenshots`: pictures of Bored in the city for the README, from a real server and a real browser."""

from __future__ import annotations

import tempfile
from pathlib import Path

from tests.browser.bored_page import DESK, PHONE, Visitor
from tests.browser.conftest import running_browser
from tests.servers import PROJECT, running_server

TARGET = PROJECT / "docs" / "screenshots"
HERE = {"latitude": 50.8491, "longitude": 4.3541, "accuracy": 10}
OFFLINE = {"SHEPHERD_BORED_TILES": "", "SHEPHERD_BORED_ROUTING": ""}
LOVED = ["mok-specialty-coffee", "goupil-le-fol", "passa-porta-bookshop", "hong-hoa", "manneken-pis"]


def main() -> None:
    """Take them all anew."""
    TARGET.mkdir(parents=True, exist_ok=True)
    with running_server(**OFFLINE) as server, tempfile.TemporaryDirectory() as profile:
        server.manage("demo_data")
        with running_browser(Path(profile)) as browser:
            take(Visitor(browser, server.url))


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


def photograph(visitor: Visitor, name: str) -> None:
    """Once the map stands still."""
    visitor.wait(lambda: not visitor.has(".leaflet-zoom-anim, .leaflet-pan-anim, .waiting"))
    visitor.photographs(TARGET / f"{name}.png")


if __name__ == "__main__":
    main()
