"""Act, record, learn (DESIGN.md section 4): decisions, and the tape on which the learner finds them again.

The actor decides and answers at once. What it decided goes onto the tape, with the reward and the outcome that the next
message of the session brings. The learner, an unmodified `learn()` on ShepherdEnv in a second thread, reads the tape as if
it were playing.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

BATCH_SECONDS = 0.02


class TapeClosed(Exception):
    """The execution ends: the learner leaves `learn()`."""


@dataclass(slots=True)
class Decision:
    """What the actor saw and did at one step."""

    obs: Any  # as ShepherdEnv shows it: with the advice, images with channels first; no batch dimension
    action: Any  # as ShepherdEnv takes it: int or array of the action space's shape
    replay: tuple[Any, ...]  # what the algorithm's own act would have returned, with a batch dimension of 1
    mask: np.ndarray | None = None  # (A,) of bool, the allowed actions; None: all
    bonus: float = 0.0  # what the learner is rewarded on top of the client's reward


@dataclass(slots=True)
class Outcome:
    """What a decision led to. `next` is the decision taken at `obs`, or None when the segment ends here."""

    reward: float
    obs: Any
    terminated: bool
    truncated: bool
    next: Decision | None
    info: dict[str, Any] | None = None  # the client's own


class Tape:
    """A queue of segments (an episode, or a piece of one) between one actor and one learner.

    A segment is its first decision and then one outcome per decision; the last outcome is terminated or truncated.
    """

    def __init__(self) -> None:
        self.batch = 1  # items that the learner waits for, but not longer than BATCH_SECONDS
        self._items: deque[Decision | Outcome] = deque()
        self._ready = threading.Condition()
        self._closed = self._paused = False
        self.current: Decision | None = None  # of the learner: the one being replayed
        self._started = False  # whether `current` has been stepped from since the last reset
        self._errands: deque[Callable[[], None]] = deque()
        self.on_taken: Any = None  # called by the learner after each item, so that a waiting actor wakes

    def __deepcopy__(self, memo: dict[int, Any]) -> Tape:
        """The same one: a copy of an environment, or of its specification, meets the same client."""
        return self

    # --- the actor's side ---
    def put(self, items: list[Decision | Outcome]) -> None:
        """Append items of one segment; the pieces of two segments must not be mixed."""
        with self._ready:
            was_empty = not self._items
            self._items.extend(items)
            if was_empty or len(self._items) >= self.batch:
                self._ready.notify()

    def close(self) -> None:
        """Make the learner leave with TapeClosed as soon as it asks for the next item."""
        with self._ready:
            self._closed = True
            self._ready.notify()

    def pause(self, paused: bool) -> None:
        """Give the learner nothing to learn from until further notice."""
        with self._ready:
            self._paused = paused
            self._ready.notify()

    def send_errand(self, errand: Any) -> None:
        """Have the learner call `errand` where it would take an item: its policy is whole then, between two updates."""
        with self._ready:
            self._errands.append(errand)
            self._ready.notify()

    @property
    def backlog(self) -> int:
        """How many items the learner has not taken yet: the lead of the actor."""
        return len(self._items)

    # --- the learner's side: what ShepherdEnv calls ---
    def first(self) -> Any:
        """The observation that begins the next segment; waits for it. A second reset in a row gives the same one."""
        if self.current is None or self._started:
            item = self._take()
            while not isinstance(item, Decision):  # the learner gave up a segment: skip the rest of it
                item = self._take()
            self.current, self._started = item, False
        return self.current.obs

    def advance(self, action: Any) -> Outcome:
        """The outcome of the recorded action; waits for it. Raises ValueError when `action` is another one."""
        if self.current is None:
            raise RuntimeError("step() before reset()")
        if not np.array_equal(action, self.current.action):
            raise ValueError(f"the algorithm acts {action}, the record says {self.current.action}")
        outcome = self._take()
        assert isinstance(outcome, Outcome)
        self._started = True
        self.current = outcome.next
        return outcome

    def _take(self) -> Decision | Outcome:
        with self._ready:
            while not self._closed and (self._errands or self._paused or not self._items):
                self._run_errand_or_wait()
            if self._closed:
                raise TapeClosed
            item = self._items.popleft()
        if self.on_taken is not None:
            self.on_taken()
        return item

    def _run_errand_or_wait(self) -> None:
        if self._errands:
            run_unlocked(self._ready, self._errands.popleft())
            return
        self._ready.wait()
        if not self._paused and 0 < len(self._items) < self.batch and not self._closed:
            self._ready.wait(BATCH_SECONDS)  # a learner that runs for every single item takes turns with the actor


def run_unlocked(lock: threading.Condition, errand: Callable[[], None]) -> None:
    """Call without the lock that is held: an errand writes to the disk, and the actor must not wait for that."""
    lock.release()
    try:
        errand()
    finally:
        lock.acquire()


class Segment:
    """The record of one session's episode, on its way to the tape.

    With `stream`, outcomes go to the tape as they come, one step late, so that an episode which breaks off can still be
    ended by truncation at the last state known. Without, the whole is kept until it ends or has `piece` steps: the segments
    of several sessions must follow each other.
    """

    def __init__(self, tape: Tape, stream: bool, piece: int) -> None:
        self._tape, self._stream, self._piece = tape, stream, piece
        self._items: list[Decision | Outcome] = []
        self._length = 0
        self.last: Decision | None = None

    def begin(self, decision: Decision) -> None:
        """The first decision."""
        self._items, self._length, self.last = [decision], 0, decision

    def follow(self, reward: float, obs: Any, decision: Decision, info: dict[str, Any] | None = None) -> None:
        """The outcome of the last decision, and the one taken there."""
        self._length += 1
        self._items.append(Outcome(reward + self._bonus(), obs, False, False, decision, info))
        self.last = decision
        if self._stream:
            self._tape.put(self._items[:-1])
            del self._items[:-1]
        elif self._length >= self._piece:
            self.hand_over()

    def end(
        self, reward: float, obs: Any, terminated: bool, truncated: bool, info: dict[str, Any] | None = None
    ) -> None:
        """The outcome of the last decision ends the episode."""
        self._items.append(Outcome(reward + self._bonus(), obs, terminated, truncated and not terminated, None, info))
        self._flush()

    def hand_over(self) -> None:
        """The session is silent: what is known ends by truncation; the last decision waits for its outcome."""
        if self.last is not None and len(self._items) > 1:
            decision = self.last
            self._cut()
            self.begin(decision)

    def break_off(self) -> None:
        """The session went away: what is known ends by truncation; the last decision has no outcome and is dropped."""
        if self.last is not None:
            self._cut()

    def _bonus(self) -> float:
        return 0.0 if self.last is None else self.last.bonus

    def _cut(self) -> None:
        tail = self._items[-1]
        if isinstance(tail, Outcome):
            tail.truncated, tail.next = True, None
            self._flush()
        else:
            self._items, self.last = [], None

    def _flush(self) -> None:
        self._tape.put(self._items)
        self._items, self.last = [], None
