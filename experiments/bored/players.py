"""Who suggests places: chance, what most people love, bandits from a library, Shepherd's executions, and an oracle."""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from mabwiser.mab import MAB, LearningPolicy

from agents_app.algorithms.spec import AgentSpec
from envs_app.execution.desk import Desk
from envs_app.execution.ledger import FileLedger
from envs_app.execution.storage import Folder
from envs_app.execution.worker import ExecutionSpec, Worker
from envs_app.messages import Message, encode_observation
from experiments.bored.city import Suggestion

WAIT_SECONDS = 60.0


class Player(Protocol):
    """Suggests, and hears what came of it."""

    def suggest(self, suggestion: Suggestion) -> int:
        """The place."""
        ...

    def hear(self, suggestion: Suggestion, place: int, reward: float) -> None:
        """What the visitor said."""
        ...

    def close(self) -> None:
        """The study is over."""
        ...


class Plain:
    """A player that needs no closing, and learns nothing unless it says so."""

    def __init__(self, actions: int, seed: int) -> None:
        self.actions, self.rng = actions, np.random.default_rng(seed)

    def hear(self, suggestion: Suggestion, place: int, reward: float) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""


class Chance(Plain):
    """Any allowed place."""

    def suggest(self, suggestion: Suggestion) -> int:
        """Drawn."""
        return int(self.rng.choice(np.flatnonzero(suggestion.allowed)))


class Oracle(Plain):
    """Knows all tastes."""

    def suggest(self, suggestion: Suggestion) -> int:
        """The place that is most probably loved."""
        return int(np.where(suggestion.allowed, suggestion.chances, -1.0).argmax())


class MostPopular(Plain):
    """The place that the largest share of people loved; unseen places count as one love in four."""

    def __init__(self, actions: int, seed: int) -> None:
        super().__init__(actions, seed)
        self.loves, self.shown = np.full(actions, 1.0), np.full(actions, 4.0)

    def suggest(self, suggestion: Suggestion) -> int:
        """Of equals, any."""
        share = self.loves / self.shown + 1e-6 * self.rng.random(self.actions)
        return int(np.where(suggestion.allowed, share, -1.0).argmax())

    def hear(self, suggestion: Suggestion, place: int, reward: float) -> None:
        """Count."""
        self.loves[place] += reward
        self.shown[place] += 1.0


class Bandit(Plain):
    """MABWiser's: a ridge regression per place on the same observation that the agent has, with a 1 beside it.

    Its models learn; what they expect is computed for all places at once, from their own matrices. Its `partial_fit` copies
    the models of all places, and its `predict_expectations` asks one after the other: 24 ms a suggestion.
    """

    def __init__(self, actions: int, seed: int, policy: Any) -> None:
        super().__init__(actions, seed)
        self.mab = MAB(list(range(actions)), policy, seed=seed)
        self.mab.fit([0], [0], [[*np.zeros(29), 1.0]])
        self.models = [self.mab._imp.arm_to_model[arm] for arm in range(actions)]
        self.beta = np.array([model.beta for model in self.models])  # (A, 30)
        self.inverse = np.array([model.A_inv for model in self.models])  # (A, 30, 30)
        self.alpha = policy.alpha

    def suggest(self, suggestion: Suggestion) -> int:
        """The allowed place of the greatest expectation; of equals, any."""
        values = self.expected(np.append(suggestion.observation, 1.0)) + 1e-9 * self.rng.random(self.actions)
        return int(np.where(suggestion.allowed, values, -np.inf).argmax())

    def expected(self, x: np.ndarray) -> np.ndarray:
        """Of each place, (A,), where (30,) is observed."""
        raise NotImplementedError

    def hear(self, suggestion: Suggestion, place: int, reward: float) -> None:
        """Learn."""
        model = self.models[place]
        model.fit(np.append(suggestion.observation, 1.0)[None], np.array([reward]))
        self.beta[place], self.inverse[place] = model.beta, model.A_inv

    def spread(self, x: np.ndarray) -> np.ndarray:
        """The deviation of what is known of each place there, (A,)."""
        return np.sqrt((self.inverse @ x) @ x)


class LinUCB(Bandit):
    """Li et al. 2010, disjoint."""

    def __init__(self, actions: int, seed: int) -> None:
        super().__init__(actions, seed, LearningPolicy.LinUCB(alpha=0.1))

    def expected(self, x: np.ndarray) -> np.ndarray:
        """An upper bound, as MABWiser's `_LinUCB.predict`."""
        return self.beta @ x + self.alpha * self.spread(x)


class Thompson(Bandit):
    """Agrawal and Goyal 2013."""

    def __init__(self, actions: int, seed: int) -> None:
        super().__init__(actions, seed, LearningPolicy.LinTS(alpha=0.1))

    def expected(self, x: np.ndarray) -> np.ndarray:
        """A draw: that of `_LinTS.predict` is of the weights, whose product with x is a Gaussian of this deviation."""
        return self.beta @ x + self.alpha * self.spread(x) * self.rng.standard_normal(self.actions)


class Peers:
    """What the executions of one process publish to each other."""

    def __init__(self, own: int, published: dict[int, tuple[int, np.ndarray]]) -> None:
        self._own, self._published = own, published

    def versions(self) -> dict[int, int]:
        """Of all but oneself."""
        return {number: version for number, (version, _) in self._published.items() if number != self._own}

    def mean_returns(self) -> dict[int, float]:
        """Not told: peers are drawn at random."""
        return {}

    def weights(self, number: int) -> np.ndarray | None:
        """The latest."""
        return self._published[number][1]


class Shepherd:
    """Executions as they are, but for their sockets; each visitor has one of them as a home."""

    def __init__(self, agent: AgentSpec, executions: int, seed: int) -> None:
        self._folder = tempfile.TemporaryDirectory()
        self._published: dict[int, tuple[int, np.ndarray]] = {}
        self._woken = threading.Event()
        self._answers: dict[str, Message] = {}
        self._desks = [self._execution(agent, number, seed) for number in range(executions)]

    def suggest(self, suggestion: Suggestion) -> int:
        """The action of the visitor's execution."""
        return int(self._step(suggestion, 0.0, False)["action"])

    def hear(self, suggestion: Suggestion, place: int, reward: float) -> None:
        """The end of the episode."""
        self._step(suggestion, reward, True)

    def close(self) -> None:
        """End the learners."""
        for desk in self._desks:
            desk.abandon()
            desk.worker.stop(WAIT_SECONDS)
        self._folder.cleanup()

    def _step(self, suggestion: Suggestion, reward: float, ends: bool) -> Message:
        desk = self._desks[suggestion.visitor % len(self._desks)]
        self._answers.clear()
        message = {"k": "step", "session": suggestion.visitor, "request": f"{suggestion.now} {ends}", "seq": None}
        message |= {"claim": True, "obs": encode_observation(suggestion.observation), "reward": reward}
        message |= {"terminated": ends, "truncated": False, "mask": suggestion.allowed.tolist()}
        desk.step(message, "here")
        while "here" not in self._answers:
            if desk.worker.failure:
                raise RuntimeError(desk.worker.failure)
            self._woken.wait(desk.next_due() if desk.next_due() is not None else WAIT_SECONDS)
            self._woken.clear()
            desk.wake()
        return self._answers["here"]

    def _execution(self, agent: AgentSpec, number: int, seed: int) -> Desk:
        folder = Path(self._folder.name)
        spec = ExecutionSpec(
            str(number),
            number,
            1,
            "bored",
            agent,
            "bored/1",
            sessions=10_000,
            seed=seed,
            save_interval=10**9,
        )
        storage, peers = Folder(folder / "saves"), Peers(number, self._published)
        worker = Worker(spec, storage, peers, self._publisher(number), self._woken.set, lambda _: None)
        return Desk(worker, FileLedger(folder / "ledger"), self._answers.__setitem__, lambda _: None)

    def _publisher(self, number: int) -> Callable[[np.ndarray], bool]:
        def publish(weights: np.ndarray) -> bool:
            version, _ = self._published.get(number, (0, weights))
            self._published[number] = version + 1, weights
            return True

        return publish
