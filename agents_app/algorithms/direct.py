"""Algorithms that cannot replay (ARS, a stranger's own): they play ShepherdEnv themselves and wait, as the thesis describes.

ARS changes its weights for every candidate and scores whole episodes; there is no decision to record. Its own action goes to
the client. One session per execution.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from agents_app.algorithms.actor import Memory, own_policy
from agents_app.algorithms.replay import Decision, Outcome, TapeClosed, run_unlocked
from agents_app.algorithms.weights import assign

POLICY_KWARGS: dict[str, Any] = {}
SHARES_WEIGHTS = False


class LiveFeed:
    """Hands observations to the algorithm and its actions back, between two threads."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._start: Any = None  # where an episode begins that the algorithm has not been given yet
        self._here: Any = None  # where the algorithm's episode stands; None between episodes
        self._outcome: Outcome | None = None  # of the last action, not given yet
        self._stepping = False  # the algorithm waits for an outcome
        self._action: Any = None
        self._closed = False
        self.on_action: Any = None  # called by the learner when an action is ready
        self._errands: deque[Callable[[], None]] = deque()
        self.mask: np.ndarray | None = None

    def __deepcopy__(self, memo: dict[int, Any]) -> LiveFeed:
        """The same one: a copy of an environment, or of its specification, meets the same client."""
        return self

    # --- the actor's side ---
    def begin(self, obs: Any) -> None:
        """The first observation of an episode; one that broke off ends by truncation where it stood."""
        with self._changed:
            self._start, self._action = obs, None
            if self._stepping and self._outcome is None:
                self._outcome = self._broken_off()
            self._changed.notify_all()

    def follow(self, outcome: Outcome) -> None:
        """The outcome of the last action."""
        with self._changed:
            self._outcome, self._action = outcome, None
            self._changed.notify_all()

    def take_action(self) -> Any:
        """The action that the algorithm chose, once; None while it has not."""
        with self._changed:
            action, self._action = self._action, None
            return action

    def pause(self, paused: bool) -> None:
        """Nothing to do: without steps to play, the algorithm waits."""

    def send_errand(self, errand: Any) -> None:
        """Have the learner call `errand` while it waits: its policy is whole then."""
        with self._changed:
            self._errands.append(errand)
            self._changed.notify_all()

    def close(self) -> None:
        """Make the learner leave with TapeClosed."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    # --- the learner's side: what ShepherdEnv calls ---
    def first(self) -> Any:
        """Where the client is; waits for it between episodes. An episode that the algorithm gives up goes on as a new one."""
        with self._changed:
            if self._here is None:
                self._wait(lambda: self._start is not None)
                self._here, self._start = self._start, None
            return self._here

    def advance(self, action: Any) -> Outcome:
        """Send the action to the client and wait for its outcome."""
        with self._changed:
            # Has the client begun anew while the algorithm thought? Then nobody waits for this action any more.
            outcome = self._ask_client(action) if self._start is None else self._broken_off()
            self._here = None if outcome.terminated or outcome.truncated else outcome.obs
            return outcome

    def _ask_client(self, action: Any) -> Outcome:
        self._action, self._stepping = action, True
        if self.on_action is not None:
            self.on_action()
        self._wait(lambda: self._outcome is not None)
        outcome, self._outcome, self._stepping = self._outcome, None, False
        assert outcome is not None
        return outcome

    def _broken_off(self) -> Outcome:
        return Outcome(0.0, self._here, False, True, None)

    def _wait(self, condition: Any) -> None:
        while not condition() and not self._closed:
            if self._errands:
                run_unlocked(self._changed, self._errands.popleft())
            else:
                self._changed.wait()
        if self._closed:
            raise TapeClosed


make_feed = LiveFeed


def learner_classes(algorithm: type[Any], policy: type[Any]) -> tuple[type[Any], type[Any]]:
    """The algorithm as it is."""
    return algorithm, policy


def attach(algorithm: Any, tape: Any) -> None:
    """Nothing to do: the algorithm plays on the feed that its ShepherdEnv has."""


def has_long_updates(algorithm: Any) -> bool:
    """No."""
    return False


def allowed_lead(algorithm: Any) -> int:
    """There is no lead: the client waits for the algorithm."""
    return 0


class DirectActor:
    """Only exploits; the decisions of learning are the algorithm's own."""

    def __init__(self, algorithm: Any) -> None:
        self.policy = own_policy(algorithm)

    def decide(self, obs: Any, memory: Memory, mask: np.ndarray | None) -> tuple[Decision, Memory]:
        """Refused: the algorithm decides itself. Raises RuntimeError."""
        raise RuntimeError("this algorithm plays ShepherdEnv directly")

    def exploit(self, obs: Any, memory: Memory, mask: np.ndarray | None) -> tuple[Any, Memory]:
        """The best action of the weights published last."""
        return self.policy.predict(obs, deterministic=True)[0], None

    def update(self, weights: np.ndarray) -> None:
        """Act with these weights from now on."""
        assign(self.policy, weights)


make_actor = DirectActor
