"""Answers that many strangers ask for at once, made once."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from threading import Lock
from time import monotonic
from typing import Any

SECONDS = 1.0  # for which an answer serves whoever asks for the same
KEPT = 256  # answers


class Recent:
    """The answers of the last second, in this process."""

    def __init__(self) -> None:
        self._answers: dict[Hashable, tuple[float, Any]] = {}
        self._lock = Lock()

    def get(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """The answer of that key, made anew if it is too old."""
        at, answer = self._answers.get(key, (-SECONDS, None))
        if monotonic() - at < SECONDS:
            return answer
        answer = make()
        self._keep(key, answer)
        return answer

    def _keep(self, key: Hashable, answer: Any) -> None:
        with self._lock:
            self._answers.pop(key, None)
            while len(self._answers) >= KEPT:  # the oldest
                self._answers.pop(next(iter(self._answers)))
            self._answers[key] = (monotonic(), answer)
