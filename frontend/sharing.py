"""Answers that many strangers ask for at once, made once."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from concurrent.futures import Future
from threading import Lock
from time import monotonic
from typing import Any

SECONDS = 1.0  # for which an answer serves whoever asks for the same
KEPT = 256  # answers


class Answer:
    """One that is being made, or was."""

    def __init__(self) -> None:
        self.told: Future[Any] = Future()
        self.at: float | None = None  # when it was there

    def is_fresh(self) -> bool:
        """Whether it may be told now, or once it is there."""
        return self.at is None or monotonic() - self.at < SECONDS

    def make(self, make: Callable[[], Any]) -> None:
        """Make it, or have all who wait for it fail as `make` does."""
        try:
            told = make()
        except BaseException as error:
            self.at = -SECONDS + monotonic()  # the next one tries again
            self.told.set_exception(error)
        else:
            self.at = monotonic()
            self.told.set_result(told)


class Recent:
    """The answers of the last second, in this process. Who asks while one is made waits for it."""

    def __init__(self) -> None:
        self._answers: dict[Hashable, Answer] = {}
        self._lock = Lock()

    def get(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """The answer of that key, made anew if it is too old. Raises what `make` does."""
        with self._lock:
            answer = self._answers.get(key)
            mine = answer is None or not answer.is_fresh()
            if answer is None or mine:
                answer = self._keep(key, Answer())
        if mine:
            answer.make(make)
        return answer.told.result()

    def _keep(self, key: Hashable, answer: Answer) -> Answer:
        self._answers.pop(key, None)
        while len(self._answers) >= KEPT:  # the oldest
            self._answers.pop(next(iter(self._answers)))
        self._answers[key] = answer
        return answer
