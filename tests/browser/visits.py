"""Visitors of Bored in the city without a browser: sessions that ask for places, and love some kinds more than others."""

from __future__ import annotations

import json
import random
from contextlib import ExitStack

from shepherd_client import Client

from tests.servers import PROJECT

PLACES = json.loads((PROJECT / "frontend" / "bored" / "places.json").read_text(encoding="utf-8"))["places"]
OBSERVATION = [0.1] * 29
LOVED = {"cafe": 0.6, "bar": 0.45, "sightseeing": 0.35, "restaurant": 0.2}  # how often, by kind; the others: FEW
FEW = 0.1


def visit(url: str, api_key: str, suggestions: int, sessions: int = 1) -> None:
    """So many suggestions, answered; the sessions take turns."""
    chance = random.Random(1)
    with ExitStack() as stack:
        client = stack.enter_context(Client(api_key, url=url))
        talks = [stack.enter_context(client.session()) for _ in range(sessions)]
        waiting = [session.act(OBSERVATION) for session in talks]  # all at once, so that each has an execution
        for number in range(suggestions):
            turn = number % sessions
            loved = chance.random() < LOVED.get(PLACES[waiting[turn]]["type"], FEW)
            talks[turn].observe(OBSERVATION, float(loved), terminated=True)
            if number < suggestions - sessions:
                waiting[turn] = talks[turn].act(OBSERVATION)
