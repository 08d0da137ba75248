"""The learner: `learn()` of the algorithm, as it is, in a thread of its own."""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback

from agents_app.algorithms.builder import ENDLESS
from agents_app.algorithms.replay import TapeClosed
from agents_app.algorithms.weights import flatten
from envs_app.execution.averaging import Averaging
from envs_app.execution.turns import Turns

FOLLOW_SECONDS = 0.03


class Diverged(ArithmeticError):
    """Learning made the weights infinite or NaN; the execution goes back to its last save."""


class Learner(threading.Thread):
    """Learns until its feed is closed; publishes its policy after each update, and saves at intervals and at the end."""

    def __init__(
        self,
        algorithm: Any,
        weights: Callable[[], np.ndarray] | None,
        save_interval: int,
        save: Callable[[], bool],
        on_published: Callable[[], bool],
        on_failed: Callable[[str], None],
        turns: Turns | None = None,
        averaging: Averaging | None = None,
    ) -> None:
        """`turns` are taken for each update; None: updates are short. The callbacks run in this thread; `on_published` returns
        whether the peers will hear of it: there may be more updates than they could follow.

        `weights` are what the actor and the peers need after an update; None: the actor shares them, and there are no peers.
        """
        super().__init__(name="learner", daemon=True)
        self.algorithm = algorithm
        self.published: np.ndarray | None = None  # replaced, never changed
        self._published_at = 0.0
        self._weights, self.save_interval = weights, save_interval
        self._save, self._on_published, self._on_failed = save, on_published, on_failed
        self._turns, self._averaging = turns, averaging
        self.updating = False  # an update is being made, or waits for its turn
        self.ending = False  # it shall end: no more turns are waited for
        self.learned_at = time.monotonic()  # when the last step was learned from
        self._saved_at = self._tried_at = algorithm.num_timesteps
        self._updates: int | None = None  # None: nothing is published yet, not even what was restored

    def run(self) -> None:
        """Learn; whatever goes wrong is reported with its traceback."""
        try:
            self._learn()
            self.save_if_newer(1)
        except BaseException:
            self._on_failed(traceback.format_exc())

    def save_if_newer(self, steps: int) -> None:
        """Save when at least `steps` were learned from since the last time; a full disk does not stop the learning.

        What could not be saved is tried again after so many steps, or with 1 at once.
        """
        now = self.algorithm.num_timesteps
        if now - (self._saved_at if steps == 1 else self._tried_at) >= steps:
            check_finite(flatten(self.algorithm.policy))
            self._tried_at = now
            if self._save():
                self._saved_at = now

    def _learn(self) -> None:
        hook = _Hook(self._between_updates, self._before_update, self._at_a_step)
        if self._weights and (optimizer := getattr(self.algorithm.policy, "optimizer", None)):
            optimizer.register_step_post_hook(self._amid_an_update)
        with suppress(TapeClosed):
            self.algorithm.learn(ENDLESS, callback=hook, log_interval=None, reset_num_timesteps=False)

    def _before_update(self) -> None:
        """Raises TapeClosed when learning shall end while others have their turn: what was learned is saved at once."""
        self.updating = True
        if self._turns is not None and not self._turns.take(lambda: self.ending):
            raise TapeClosed

    def _between_updates(self) -> None:
        self.updating = False
        if self._turns is not None:
            self._turns.give_back()
        if self.algorithm._n_updates != self._updates:
            self._updates = self.algorithm._n_updates
            if self._weights:
                self._publish(self._weights())
        self.save_if_newer(self.save_interval)

    def _at_a_step(self) -> None:
        """A newcomer takes over what is known as soon as it hears of it, not after a rollout of its own."""
        self.learned_at = time.monotonic()
        if self._weights and self._averaging and self._averaging.is_new and self._averaging.go_on():
            self._hand_over(self._weights())

    def catch_up(self) -> None:
        """With the others, while there is nothing to learn from; an errand."""
        if self._weights and self._averaging and self._averaging.catch_up():
            self._hand_over(self._weights())

    def _amid_an_update(self, *_: Any) -> None:
        """Let the actor follow an update while it is made: what it decides meanwhile is not older than a few minibatches."""
        if self._weights and time.monotonic() - self._published_at >= FOLLOW_SECONDS:
            self._hand_over(self._weights())

    def _publish(self, weights: np.ndarray) -> None:
        """Others are heard as often as one is heard oneself, so that all changes between two times count alike."""
        self._hand_over(weights)
        heard = self._on_published()
        if heard and self._weights and self._averaging and self._averaging.go_on():
            self._hand_over(self._weights())

    def _hand_over(self, weights: np.ndarray) -> None:
        """To the actor. Raises Diverged: nobody acts with weights that are not finite."""
        check_finite(weights)
        self.published, self._published_at = weights, time.monotonic()


def check_finite(weights: np.ndarray) -> None:
    """Whether they may be handed on. Raises Diverged."""
    if not np.isfinite(weights).all():
        raise Diverged("the weights are no longer finite: try a smaller learning rate, or scale the rewards")


class _Hook(BaseCallback):
    """Calls back where SB3 begins to collect (the policy is whole then, between two updates), at each step, and at the end."""

    def __init__(
        self, between_updates: Callable[[], None], before_update: Callable[[], None], at_a_step: Callable[[], None]
    ) -> None:
        super().__init__()
        self.between_updates, self.before_update, self.at_a_step = between_updates, before_update, at_a_step

    def _on_rollout_end(self) -> None:
        self.before_update()

    def _on_rollout_start(self) -> None:
        self.between_updates()

    def _on_step(self) -> bool:
        self.at_a_step()
        return True
