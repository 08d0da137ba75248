"""What may happen to sessions, in any order, beside a model of what each must be answered (hypothesis, stateful tests).

A model is a few lines: the number of the last step, the answer to it, and the sum of the running episode. Whatever is killed in
between, every answer and every row of the database must be the model's.
"""

from __future__ import annotations

import os
import signal
import time
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import httpx
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    Bundle,
    RuleBasedStateMachine,
    consumes,
    initialize,
    precondition,
    rule,
    run_state_machine_as_test,
)

from tests.faults.players import PATIENCE, returns_of_session
from tests.servers import Server, wait_for

OBS = [0.1, -0.2, 0.3, -0.4]
MOST = 5  # open sessions: with two on each execution, three executions
KILLS = 2  # of each kind in one example: each costs a second or two
BAD: list[dict[str, Any]] = [
    {"obs": [1.0]},
    {"obs": None},
    {"reward": "1"},
    {"terminated": 1},
    {"seq": -1},
    {"typo": 1},
]
ENDS: list[dict[str, bool]] = [{}, {}, {}, {"terminated": True}, {"truncated": True}]


@dataclass
class Known:
    """A session as its client knows it."""

    key: str
    seq: int = 0
    total: float = 0.0
    length: int | None = None  # of the running episode; None between episodes
    last: tuple[dict[str, Any], dict[str, Any]] | None = None  # the last step and its answer
    episodes: list[tuple[float, int]] = field(default_factory=list)

    def step(self, reward: float, **ends: bool) -> dict[str, Any]:
        """The next step. What begins an episode cannot end it."""
        ends = ends if self.length is not None else {}
        step = {"obs": OBS, "reward": reward, "terminated": False, "truncated": False, "seq": self.seq + 1}
        return step | ends

    def answered(self, step: dict[str, Any], answer: dict[str, Any]) -> None:
        """Check the answer to a new step, and take note of it."""
        self.seq, self.last = self.seq + 1, (step, answer)
        begins, ends = self.length is None, step["terminated"] or step["truncated"]
        self.total, self.length = (0.0, 0) if begins else (self.total + step["reward"], (self.length or 0) + 1)
        assert answer["seq"] == self.seq
        assert answer.get("episode_return") == (self.total if ends else None)
        assert answer["action"] is None if ends else answer["action"] in (0, 1)
        if ends:
            self.episodes.append((self.total, self.length))
            self.length = None


class SessionMachine(RuleBasedStateMachine):
    """Sessions of one agent of a real server."""

    sessions: Bundle[Known] = Bundle("sessions")

    def __init__(self, server: Server, api_key: str) -> None:
        super().__init__()
        self.server, self.api_key = server, api_key
        self.http = httpx.Client(timeout=30)
        self.opened: list[Known] = []
        self.closed: list[Known] = []
        self.kills: dict[str, int] = {}

    @initialize(target=sessions)
    def begin(self) -> Known:
        """There is always one to break."""
        return self._log_in()

    @precondition(lambda self: len(self.opened) - len(self.closed) < MOST)
    @rule(target=sessions)
    def log_in(self) -> Known:
        """A new session."""
        return self._log_in()

    @rule(known=sessions, quarters=st.integers(-8, 8), ends=st.sampled_from(ENDS))
    def step(self, known: Known, quarters: int, ends: dict[str, bool]) -> None:
        """Quarters have exact sums."""
        step = known.step(quarters / 4, **ends)
        answer = self._step(known, step)
        assert answer.status_code == 200, answer.text
        known.answered(step, answer.json())

    @rule(known=sessions)
    def repeat(self, known: Known) -> None:
        """The stored answer, whoever has it now."""
        if known.last is not None:
            step, stored = known.last
            answer = self._step(known, step)
            assert (answer.status_code, answer.json()) == (200, stored)

    @rule(known=sessions, bad=st.sampled_from(BAD))
    def send_nonsense(self, known: Known, bad: dict[str, Any]) -> None:
        """Refused; later steps show that it left no trace."""
        assert self._step(known, known.step(1.0) | bad).status_code == 422

    @rule(known=sessions, ahead=st.integers(2, 1000))
    def leave_a_gap(self, known: Known, ahead: int) -> None:
        """Refused, too; but whoever never stepped may begin with any number."""
        if known.seq:
            answer = self._step(known, known.step(1.0) | {"seq": known.seq + ahead})
            assert (answer.status_code, answer.json()["code"]) == (409, "sequence_gap")

    @rule(which=st.integers(0, 9))
    def kill_an_execution(self, which: int) -> None:
        """Any of them."""
        self.kill("execution", self.server.execution_pids(), which)

    @rule(which=st.integers(0, 9))
    def kill_a_web_process(self, which: int) -> None:
        """Any of them."""
        self.kill("web", self.server.web_pids(), which)

    @rule(known=consumes(sessions))
    def close(self, known: Known) -> None:
        """The key opens nothing any more; other web processes know it within seconds."""
        assert self._request("DELETE", "session", known.key).status_code in (204, 401)  # 401: when it is sent twice
        self.closed.append(known)

    def teardown(self) -> None:
        """Each answered episode is in the database, once, and no other is."""
        for known in self.opened:
            if known not in self.closed:
                self.close(known)
            wait_for(partial(self._is_closed, known), what="the session to be closed everywhere")
            assert returns_of_session(self.server, known.key) == known.episodes
        self.http.close()

    def kill(self, kind: str, pids: list[int], which: int, most: int = KILLS) -> None:
        """kill -9 of one of these, unless there were enough of the kind."""
        self.kills[kind] = self.kills.get(kind, 0) + 1
        if pids and self.kills[kind] <= most:
            with suppress(ProcessLookupError):
                os.kill(pids[which % len(pids)], signal.SIGKILL)

    def _log_in(self) -> Known:
        answer = self._request("POST", "sessions", self.api_key)
        assert answer.status_code == 201, answer.text
        self.opened.append(Known(answer.json()["session_key"]))
        return self.opened[-1]

    def _is_closed(self, known: Known) -> bool:
        step = known.last[0] if known.last else known.step(1.0)
        return self._step(known, step).status_code == 401

    def _step(self, known: Known, step: dict[str, Any]) -> httpx.Response:
        return self._request("POST", "step", known.key, json=step)

    def _request(self, method: str, path: str, key: str, **content: Any) -> httpx.Response:
        """The first answer that does not say to come back, as any good client has it."""
        deadline = time.monotonic() + PATIENCE
        headers = {"Authorization": f"Bearer {key}"}
        while True:
            try:
                answer = httpx.request(
                    method, f"{self.server.url}api/v1/{path}", headers=headers, timeout=30, **content
                )
                if answer.status_code != 503:
                    return answer
                wait = float(answer.headers["Retry-After"])
            except httpx.TransportError:
                wait = 0.2
            assert time.monotonic() < deadline, "the server does not come back"
            time.sleep(wait)


def run(machine: type[SessionMachine], server: Server, api_key: str, examples: int) -> None:
    """Play so many examples. What fails is not shrunk: processes do not die the same way twice."""
    options = settings(
        max_examples=examples,
        stateful_step_count=40,
        deadline=None,
        derandomize=True,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    run_state_machine_as_test(lambda: machine(server, api_key), settings=options)
