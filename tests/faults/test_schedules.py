"""Random schedules of all that clients and accidents do, against a simple model of what must be answered."""

from __future__ import annotations

import os
import random
import signal
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule, run_state_machine_as_test
from shepherd_client import Client, InvalidObservation, InvalidReward, Reply, SequenceGap, Session, UnknownSession

from tests.faults.inside import HERE, executions_of, transport
from tests.faults.players import returns_of_session
from tests.servers import Server

Agent = Callable[[str], tuple[str, str]]
ENDS = ["", "", "terminated", "truncated"]
REWARDS = st.integers(-8, 8).map(lambda quarters: quarters / 4)


@dataclass
class Model:
    """What must be answered to one session."""

    session: Session
    last: Reply | None = None
    playing: bool = False
    total: float = 0.0
    length: int = 0
    episodes: list[tuple[float, int]] = field(default_factory=list)

    def step(self, reward: float, ends: str, numbered: bool = True) -> None:
        """Take a step and check the answer."""
        said = {ends: True} if ends else {}
        if numbered:
            reply = self.session.step(HERE, reward, **said)
        else:
            reply = self._step_without_number(
                {"obs": HERE, "reward": reward, "terminated": False, "truncated": False} | said
            )
        if self.playing:
            self.total, self.length = self.total + reward, self.length + 1
        assert reply.seq == (self.last.seq if self.last else 0) + 1
        assert (reply.action is None) == bool(ends)
        assert reply.episode_return == (self.total if ends else None)
        if ends and self.playing:
            self.episodes.append((self.total, self.length))
        if ends or not self.playing:
            self.total, self.length = 0.0, 0
        self.playing, self.last = not ends, reply

    def _step_without_number(self, what: dict[str, Any]) -> Reply:
        """As a client may that keeps no count: every request is a new step."""
        answer = self.session._connection.request("POST", "/api/v1/step", self.session.key, what)
        self.session.seq = answer["seq"]
        return Reply(answer["action"], answer["seq"], answer.get("episode_return"))


class Schedules(RuleBasedStateMachine):
    """Sessions of one agent, and what happens to them."""

    server: Server
    agent: str
    client: Client

    def __init__(self) -> None:
        super().__init__()
        self.models: list[Model] = []

    def is_ready(self) -> bool:
        """Whether no execution is being saved or replaced: a step without a number cannot be repeated."""
        return all(execution["state"] in ("acting", "waiting") for execution in executions_of(self.server, self.agent))

    def pick(self, number: int) -> Model:
        """One of the open sessions."""
        return self.models[number % len(self.models)]

    @precondition(lambda self: len(self.models) < 4)
    @rule()
    def log_in(self) -> None:
        """Another session."""
        self.models.append(Model(self.client.session()))

    @precondition(lambda self: self.models)
    @rule(number=st.integers(0, 3), rewards=st.lists(REWARDS, min_size=1, max_size=20), ends=st.sampled_from(ENDS))
    def step(self, number: int, rewards: list[float], ends: str) -> None:
        """Some steps, of which the last may end the episode."""
        for reward in rewards[:-1]:
            self.pick(number).step(reward, "")
        self.pick(number).step(rewards[-1], ends)

    @precondition(lambda self: any(model.playing for model in self.models))
    @rule(number=st.integers(0, 3), reward=REWARDS)
    def step_without_number(self, number: int, reward: float) -> None:
        """A step in an episode by a client that does not count."""
        model = self.pick(number)
        if model.playing and self.is_ready():
            model.step(reward, "", numbered=False)

    @precondition(lambda self: any(model.last for model in self.models))
    @rule(number=st.integers(0, 3), obs=st.sampled_from([HERE, [1.0, 1.0, 1.0, 1.0]]), reward=REWARDS)
    def repeat(self, number: int, obs: Any, reward: float) -> None:
        """The last step again, whatever it says now: the stored answer."""
        model = self.pick(number)
        if model.last is None:
            return
        model.session.seq -= 1
        assert model.session.step(obs, reward) == model.last

    @precondition(lambda self: self.models)
    @rule(number=st.integers(0, 3), bad=st.sampled_from(["obs", "reward", "seq"]))
    def step_badly(self, number: int, bad: str) -> None:
        """A step that is refused: as if it had never come."""
        session = self.pick(number).session
        if bad == "obs":
            with pytest.raises(InvalidObservation):
                session.step([0.0])
        elif bad == "reward":
            with pytest.raises(InvalidReward):
                session.step(HERE, float("nan"))
        elif self.pick(number).last:
            session.seq += 5
            with pytest.raises(SequenceGap):
                session.step(HERE, 1.0)
            session.seq -= 5

    @rule(seed=st.integers(0, 100))
    def kill_an_execution(self, seed: int) -> None:
        """kill -9 of any of them."""
        if executions := executions_of(self.server, self.agent):
            with suppress(ProcessLookupError):
                os.kill(random.Random(seed).choice(executions)["pid"], signal.SIGKILL)

    @rule()
    def restart_the_agent(self) -> None:
        """What the administration's action does."""
        transport(self.server).stop(self.agent, "restart")

    @precondition(lambda self: len(self.models) > 1)
    @rule(number=st.integers(0, 3))
    def close(self, number: int) -> None:
        """End a session: its key opens nothing any more."""
        model = self.models.pop(number % len(self.models))
        key, seq = model.session.key, model.session.seq
        model.session.close()
        self.check(model)
        with pytest.raises(UnknownSession):
            self.client.resume(key, seq).step(HERE)

    def teardown(self) -> None:
        """What was answered is what the database has."""
        for model in self.models:
            self.check(model)
            model.session.close()

    def check(self, model: Model) -> None:
        """Every answered episode, once, and no other."""
        assert returns_of_session(self.server, model.session.key) == model.episodes


def test_every_schedule_is_answered_as_the_model_says(own: Server, agent: Agent) -> None:
    identity, key = agent("schedules")
    with Client(key, own.url, patience=60) as client:
        Schedules.server, Schedules.agent, Schedules.client = own, identity, client
        chosen = settings(
            max_examples=8,
            stateful_step_count=30,
            deadline=None,
            phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
            database=None,
        )
        run_state_machine_as_test(Schedules, settings=chosen)
