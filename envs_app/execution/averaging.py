"""Executions that learn together: what all their updates change is averaged, as in federated averaging (McMahan et al. 2017).

Nobody waits for anybody. So changes are averaged, not weights: the weights that a peer published last are old already, and to be
drawn to their mean after each update would slow all of them down (docs/adr/0016). An execution publishes, behind its policy, the
sum of all that its own updates have changed so far; of this a peer takes over what has been added since it heard it last.
A little of the mean of the weights keeps them together all the same.

How far what an execution knows goes back is counted in updates, one after the other (a logical clock, Lamport 1978). So whoever
begins does not go by what somebody knew who has long stopped learning, nor does that undo what was restored from a save.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol

import numpy as np

from agents_app.algorithms.normalising import Normaliser
from agents_app.algorithms.weights import assign, flatten, parameters_of

FULL_VOICE = 10  # updates
FIRST_UPDATE = 2  # the publication after it; the one before is what an execution begins with
TAIL = 2  # numbers at the end of a publication: the voice, and what it knows
PULL = 0.1  # towards the mean of the weights, after each update


class Others(Protocol):
    """Where the publications of other executions are found: of advisors.py's Peers what is needed here."""

    def versions(self) -> dict[int, int]:
        """The live peers that have published: number of the execution, and how many times it has."""
        ...

    def weights(self, number: int) -> np.ndarray | None:
        """The latest publication of a peer; None when it has just gone."""
        ...


class News(NamedTuple):
    """What is heard of one execution. P parameters."""

    voice: int  # how much it counts
    parameters: np.ndarray  # (P,)
    change: np.ndarray | None  # (P,), by its own updates since it was heard last; None: it never was
    buffers: np.ndarray = np.empty(0, np.float32)  # (W - P,), what it sees with
    knows: int = 0  # updates that lie behind it, one after the other


class Heard(NamedTuple):
    """What an execution said last."""

    version: int
    total: np.ndarray | None  # (P,), of all changes by its own updates; None: what it said does not fit


NEVER = Heard(0, None)


class Averaging:
    """Brings together what an execution and its peers learn. Belongs to the learner's thread."""

    def __init__(self, policy: Any, others: Others, knows: int = 0) -> None:
        """The policy is about to learn. `knows`: updates that lie behind it, one after the other, if it is from a save."""
        self._policy, self._others = policy, others
        self._normaliser = next((it for it in policy.modules() if isinstance(it, Normaliser)), None)
        self.parameters = parameters_of(policy)
        weights = flatten(policy)
        self._size = weights.size
        self._start = self._said = weights[: self.parameters]  # what the next merger and the next publication go by
        self._total = np.zeros_like(self._start)  # of all changes by own updates
        self.knows = self._brought = knows
        self._published = 0
        self._heard: dict[int, Heard] = {}  # by number

    @property
    def is_new(self) -> bool:
        """Whether it has neither learned nor heard anything."""
        return self._published == 1 and all(it.total is None for it in self._heard.values())

    @property
    def _voice(self) -> int:
        return min(max(0, self._published - 1) + self._brought, FULL_VOICE)

    def publication(self, weights: np.ndarray) -> np.ndarray:
        """What the others need, after an update: the whole policy, (W,), the sum of the changes, (P,), and the tail, (2,)."""
        self.knows += min(self._published, 1)
        self._published += 1
        own = weights[: self.parameters]
        self._total += own - self._said
        self._said = own
        return np.concatenate([weights, self._total, [self._voice, self.knows]], dtype=np.float32)

    def go_on(self) -> bool:
        """Take over what others have learned, after a publication; returns whether there was anything to take.

        Buffers, in which observation normalisation is, stay one's own: peers may see other units (Li et al. 2021, FedBN).
        Who has seen nothing yet sees as whoever knows most: the weights that it takes over would be of no use to it otherwise.
        """
        news = list(self._news())
        if self._published == 1:
            news = self._ahead(news)
        if not news:
            self._start = self._said
            return False
        own, buffers = np.split(flatten(self._policy), [self.parameters])
        merged = self._merged(own, news)
        self._start = self._said = own if merged is None else merged
        if merged is None:
            return False
        self.knows = max(self.knows, *(it.knows for it in news))
        if self._normaliser and not self._normaliser.has_seen:
            buffers = max(news, key=lambda it: it.knows).buffers
        assign(self._policy, np.concatenate([merged, buffers], dtype=np.float32))
        return True

    def catch_up(self) -> bool:
        """One whose client is silent, and whom others have left behind, takes over what they know; returns whether it did.

        Else whoever comes to it next would act on what was known when it was used last.
        """
        if self._published == 0 or self._most_known() <= self.knows + FULL_VOICE:
            return False
        before, self._published = self._published, 1  # what a newcomer would take over
        took = self.go_on()
        self._published = before
        return took

    def _most_known(self) -> int:
        """By any of the others that fits."""
        news = [it for it, version in self._others.versions().items() if self._is_news(it, version)]
        said = [it for number in news if (it := self._others.weights(number)) is not None]
        return max((int(it[-1]) for it in said if it.size == self._size + self.parameters + TAIL), default=0)

    def _is_news(self, number: int, version: int) -> bool:
        """Whether an execution has learned, and published since it was heard last."""
        return version >= FIRST_UPDATE and version != self._heard.get(number, NEVER).version

    def _ahead(self, news: list[News]) -> list[News]:
        """Whom one that has not learned yet follows: who knows about the most, and no less than it brought from a save."""
        least = max([self._brought, *(it.knows - FULL_VOICE for it in news)])
        followed = [it for it in news if it.knows >= least]
        if followed:
            self._brought = 0
        return followed

    def _merged(self, own: np.ndarray, news: list[News]) -> np.ndarray | None:
        """What to go on from; None: somebody diverges, who takes nobody along."""
        merged = merge(self._start, News(self._voice, own, own - self._start), news)
        return merged if np.isfinite(merged).all() else None

    def _news(self) -> Iterator[News]:
        """Of those that have published since they were heard last. A network of another shape tells nothing."""
        versions = self._others.versions()
        self._heard = {it: heard for it, heard in self._heard.items() if it in versions}  # who has gone is forgotten
        for number, version in versions.items():
            before = self._heard.get(number, NEVER)
            if not self._is_news(number, version) or (said := self._others.weights(number)) is None:
                continue
            weights, total = said[: self._size], said[self._size : -TAIL].copy()
            if said.size != self._size + self.parameters + TAIL:
                self._heard[number] = Heard(version, None)
                continue
            self._heard[number] = Heard(version, total)
            known = np.zeros_like(total) if before.total is None and version == FIRST_UPDATE else before.total
            if known is None or not np.array_equal(total, known):  # else it was read before it was announced
                change = None if known is None else total - known
                parameters, buffers = np.split(weights, [self.parameters])
                yield News(int(said[-TAIL]), parameters, change, buffers, int(said[-1]))


def merge(start: np.ndarray, own: News, news: list[News]) -> np.ndarray:
    """Parameters to go on from, (P,): those before one's own update, the mean of all changes, a pull to the mean of the weights.

    Whoever has learned less than another is pulled the more: a newcomer takes over what is known.
    """
    everybody = [own, *news]
    changed = start + _mean([(it.voice, it.change) for it in everybody if it.change is not None])
    kept = np.float32((1.0 - PULL) * min(1.0, own.voice / max(it.voice for it in news)))
    return kept * changed + (1 - kept) * _mean([(it.voice, it.parameters) for it in everybody])


def _mean(said: list[tuple[int, np.ndarray]]) -> np.ndarray:
    """By voices. Of those who have none, nothing."""
    loudness = max(1, sum(voice for voice, _ in said))
    return sum((np.float32(voice / loudness) * vector for voice, vector in said), np.zeros_like(said[0][1]))
