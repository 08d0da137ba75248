"""Agents that only a transport knows, and sessions that play with them."""

from __future__ import annotations

import itertools
import uuid
from dataclasses import asdict
from typing import Any

from agents_app.spaces import parse_space
from envs_app.errors import NoCapacity
from envs_app.execution.worker import ExecutionSpec
from envs_app.messages import Message, encode_observation
from envs_app.transports.base import Address, Claim, Transport
from tests.algorithms.specs import make_spec
from tests.servers import wait_for
from tests.transports.engines import Engine

TIMEOUT = 20.0
GIVEN_BY_TRANSPORT = {"turns"}
ids = itertools.count(1)


class Agent:
    """An agent that only the transport knows, its run, and the numbers of its executions."""

    def __init__(self, engine: Engine, most: int = 4, places: int = 1, **options: Any) -> None:
        self.engine, self.transport = engine, engine.connect()
        self.most, self.places = most, places
        self.id, self.run = str(uuid.uuid4()), next(ids)
        names = {"learning", "start_from", "save_interval", "reclaim_seconds", "seed"}
        self.facts = {name: options.pop(name) for name in list(options) if name in names}
        self.spec = make_spec(**{"advice_method": "none", "observations": 5} | options)
        self.numbers = itertools.count(1)

    def claim(self, session: int) -> Claim:
        """A session's claim."""
        return Claim(self.id, self.run, session, self.most, self.places)

    def launch(self, session: int, exclude: Any = (), transport: Transport | None = None) -> Address:
        """Start an execution for the session, unless there is one for it."""
        number = next(self.numbers)
        facts: dict[str, Any] = {"seed": 1, "sessions": self.places} | self.facts
        spec = ExecutionSpec(str(uuid.uuid4()), number, self.run, self.id, self.spec, f"{self.id}/{self.run}", **facts)
        given = {name: value for name, value in asdict(spec).items() if name not in GIVEN_BY_TRANSPORT}
        return (transport or self.transport).launch(self.claim(session), given, 10_000, exclude)

    def find(self, session: int, transport: Transport | None = None) -> Address:
        """As sessions do it: take what is there, or launch; wait while executions are being saved."""

        def found() -> Address | None:
            try:
                used = transport or self.transport
                return used.acquire(self.claim(session)) or self.launch(session, transport=used)
            except (NoCapacity, OSError):
                return None

        return wait_for(found, what="an execution")

    def status(self) -> dict[str, dict[str, Any]]:
        """The live executions, by uid."""
        return {status["uid"]: status for status in self.transport.status(self.id)}

    def player(self) -> Player:
        """A session with an execution."""
        return Player(self)

    def events(self, *kinds: str) -> list[dict[str, Any]]:
        """What happened to this agent."""
        return [e for e in self.transport.events(0) if e["agent"] == self.id and (not kinds or e["k"] in kinds)]

    def wait_for_event(self, kind: str, count: int = 1) -> list[dict[str, Any]]:
        """The events of a kind, when there are so many."""
        wait_for(lambda: len(self.events(kind)) >= count, what=f"{count} x {kind}")
        return self.events(kind)


class Player:
    """A session that steps over the transport."""

    def __init__(self, agent: Agent) -> None:
        self.agent, self.session = agent, next(ids)
        self.space = parse_space(agent.spec.observation_space)
        self.address: Address | None = None
        self.seq = 0

    def message(self, obs: Any = 0, reward: float = 0.0, terminated: bool = False, **fields: Any) -> Message:
        """The next step."""
        message: Message = {"k": "step", "session": self.session, "request": uuid.uuid4().hex, "seq": self.seq + 1}
        message |= {"claim": True, "obs": encode_observation(obs), "reward": reward, "mask": None}
        return message | {"terminated": terminated, "truncated": False} | fields

    def send(self, message: Message, timeout: float = TIMEOUT) -> Message:
        """Send it to the execution that the session has."""
        self.address = self.address or self.agent.find(self.session)
        answer = self.agent.transport.call(self.address, message, timeout)
        if answer["k"] == "answer":
            self.seq = answer["seq"]
        return answer

    def step(self, obs: Any = 0, reward: float = 0.0, terminated: bool = False, **fields: Any) -> Message:
        """Take the next step."""
        return self.send(self.message(obs, reward, terminated, **fields))

    def end(self, reward: float = 0.0) -> dict[str, Any]:
        """End the episode; returns what is known of it."""
        return self.step(0, reward, terminated=True)["episode"]

    def play(self, steps: int, length: int = 10) -> None:
        """Take so many steps, in episodes of this length."""
        for number in range(steps):
            assert self.step(number % 5, 1.0, number % length == length - 1)["k"] == "answer"
