"""An execution in this process, without sockets: a real worker with its learner, a desk, and a client that waits."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces

from agents_app.algorithms.spec import AgentSpec
from agents_app.spaces import parse_space
from envs_app.execution.desk import Desk
from envs_app.execution.ledger import FileLedger
from envs_app.execution.storage import Folder, Storage
from envs_app.execution.worker import ExecutionSpec, Worker
from envs_app.messages import Message, encode_observation
from tests.algorithms.specs import make_spec

PATIENCE = 30.0
OF_EXECUTIONS = {field.name for field in fields(ExecutionSpec)}
requests = itertools.count(1)


class FixedPeers:
    """Peers whose policies a test puts there."""

    def __init__(self) -> None:
        self.policies: dict[int, np.ndarray] = {}
        self.published: dict[int, int] = {}
        self.returns: dict[int, float] = {}

    def put(self, number: int, weights: np.ndarray, mean_return: float | None = None) -> None:
        """Execution `number` publishes."""
        self.policies[number] = weights
        if mean_return is not None:
            self.returns[number] = mean_return
        self.published[number] = self.published.get(number, 0) + 1

    def versions(self) -> dict[int, int]:
        """The peers that have published."""
        return self.published

    def mean_returns(self) -> dict[int, float]:
        """How good they are."""
        return self.returns

    def weights(self, number: int) -> np.ndarray | None:
        """What a peer published last."""
        return self.policies.get(number)


class Station:
    """One execution. `options` are fields of the agent or of the execution, whichever has them."""

    def __init__(self, folder: Path, uid: str = "first", storage: Storage | None = None, **options: Any) -> None:
        own = {name: options.pop(name) for name in list(options) if name in OF_EXECUTIONS}
        agent: AgentSpec = options.pop("agent", None) or make_spec(**{"advice_method": "none"} | options)
        facts: dict[str, Any] = {"uid": uid, "number": 1, "run": 1, "agent_id": "agent", "seed": 1}
        spec = ExecutionSpec(**facts | {"agent": agent, "saves": "agent/1"} | own)
        self.storage = storage or Folder(folder / "saves")
        self.reports: list[Message] = []
        self.answers: dict[str, Message] = {}
        self.peers = FixedPeers()
        self.published: list[np.ndarray] = []
        self.throttled = False  # it may not publish again yet
        self._woken = threading.Event()
        self._held: list[Callable[[], None]] = []
        self.space = parse_space(agent.observation_space)
        self.space.seed(1)
        self.worker = Worker(spec, self.storage, self.peers, self._publish, self._woken.set, self.reports.append)
        self.ledger = FileLedger(folder / "ledger")
        self.desk = Desk(self.worker, self.ledger, self._take_answer, self.reports.append)

    def __enter__(self) -> Station:
        return self

    def __exit__(self, *error: object) -> None:
        for let_go in self._held:
            let_go()
        self.worker.stop(PATIENCE)

    @property
    def algorithm(self) -> Any:
        """The algorithm, which belongs to the learner."""
        return self.worker.algorithm

    @property
    def learned_from(self) -> int:
        """Steps that the learner has taken from its feed."""
        return self.algorithm.num_timesteps

    def told(self, kind: str) -> list[Message]:
        """What the execution reported of this kind."""
        return [report for report in self.reports if report["k"] == kind]

    # --- the client's side ---
    def post(
        self,
        session: int = 1,
        obs: Any = None,
        reward: float = 0.0,
        terminated: bool = False,
        truncated: bool = False,
        seq: int | None = None,
        claim: bool = True,
        mask: list[bool] | None = None,
        request: str = "",
        to: str = "",
    ) -> str:
        """Send a step; returns its request number, under which the answer comes, unless `to` says where."""
        request = request or f"request {next(requests)}"
        obs = self.somewhere() if obs is None else obs
        message = {"k": "step", "session": session, "request": request, "seq": seq, "claim": claim}
        message |= {"obs": encode_observation(obs), "reward": reward, "mask": mask}
        self.desk.step({**message, "terminated": terminated, "truncated": truncated}, to or request)
        return request

    def step(self, session: int = 1, obs: Any = None, reward: float = 0.0, **options: Any) -> Message:
        """Send a step and wait for the answer."""
        return self.wait_for_answer(self.post(session, obs, reward, **options))

    def wait_for_answer(self, request: str) -> Message:
        """The answer to a request."""
        self.wait_until(lambda: request in self.answers, f"the answer to {request}")
        return self.answers[request]

    def wait_until(self, condition: Callable[[], Any], what: str = "") -> None:
        """Let the desk work until the condition holds."""
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert not self.worker.failure, self.worker.failure
            assert time.monotonic() < deadline, f"waited in vain for {what or condition}"
            self._woken.wait(0.02)
            self._woken.clear()
            self.desk.wake()

    def play(self, steps: int, session: int = 1, length: int = 10, reward: float = 1.0) -> list[Message]:
        """Episodes of `length` steps, until `steps` outcomes were sent; they terminate and are truncated in turn."""
        answers, ends = [self.step(session)], 0
        for number in range(1, steps + 1):
            if number % length:
                answers.append(self.step(session, reward=reward))
                continue
            ends += 1
            answers.append(self.step(session, reward=reward, terminated=ends % 2 == 1, truncated=ends % 2 == 0))
            if number < steps:
                answers.append(self.step(session))
        return answers

    def somewhere(self) -> Any:
        """An observation."""
        obs = self.space.sample()
        return int(obs) if isinstance(self.space, spaces.Discrete) else obs

    def hold_learner(self) -> Callable[[], None]:
        """Let the learner do nothing, as if it were amid a long update; returns what lets it go on."""
        held, gate = threading.Event(), threading.Event()

        def wait() -> None:
            held.set()
            gate.wait(PATIENCE)

        self.worker.feed.send_errand(wait)
        assert held.wait(PATIENCE), "the learner is too busy to be held"
        self._held.append(gate.set)
        return gate.set

    def _publish(self, weights: np.ndarray) -> bool:
        if not self.throttled:
            self.published.append(weights)
        return not self.throttled

    def _take_answer(self, to: str, message: Message) -> None:
        self.answers[to] = message
