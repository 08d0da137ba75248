"""Executions that learn together: what all their updates change is averaged, as in federated averaging (McMahan et al. 2017).

Nobody waits for anybody. So changes are averaged, not weights: the weights that a peer published last are old already, and to be
drawn to their mean after each update would slow all of them down (docs/adr/0016). An execution publishes, behind its policy, the
sum of all that its own updates have changed so far; of this a peer takes over what has been added since it heard it last.
A little of the mean of the weights keeps them together all the same.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol

import numpy as np

from agents_app.algorithms.normalising import Normaliser
from agents_app.algorithms.weights import assign, flatten, parameters_of

FULL_VOICE = 10  # updates
FIRST_UPDATE = 2  # the publication after it
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


class Averaging:
    """Brings together what an execution and its peers learn. Belongs to the learner's thread."""

    def __init__(self, policy: Any, others: Others) -> None:
        """The policy is about to learn."""
        self._policy, self._others = policy, others
        self._normaliser = next((it for it in policy.modules() if isinstance(it, Normaliser)), None)
        self.parameters = parameters_of(policy)
        self._start = flatten(policy)[: self.parameters]  # of the update that comes
        self._total = np.zeros_like(self._start)  # of all changes by own updates
        self._published = 0
        self._heard: dict[int, tuple[int, np.ndarray]] = {}  # versions and totals of the others, by number

    @property
    def is_new(self) -> bool:
        """Whether it has neither learned nor heard anything."""
        return self._published == 1 and not self._heard

    def publication(self, weights: np.ndarray) -> np.ndarray:
        """What the others need, after an update: the whole policy, (W,), and the sum of the changes, (P,) behind it."""
        self._published += 1
        self._total += weights[: self.parameters] - self._start
        return np.concatenate([weights, self._total])

    def go_on(self) -> bool:
        """Take over what others have learned, after a publication; returns whether there was anything to take.

        Buffers, in which observation normalisation is, stay one's own: peers may see other units (Li et al. 2021, FedBN).
        Who has seen nothing yet sees as whoever knows most: the weights that it takes over would be of no use to it otherwise.
        """
        weights = flatten(self._policy)
        own, buffers = np.split(weights, [self.parameters])
        news = list(self._news(weights.size))
        merged = self._merged(own, news)
        self._start = own if merged is None else merged
        if merged is not None:
            if self._normaliser and not self._normaliser.has_seen:
                buffers = max(news, key=lambda it: it.voice).buffers
            assign(self._policy, np.concatenate([merged, buffers], dtype=np.float32))
        return merged is not None

    def _merged(self, own: np.ndarray, news: list[News]) -> np.ndarray | None:
        """What to go on from; None: nobody has learned anything, or somebody diverges, who takes nobody along."""
        if not news:
            return None
        merged = merge(self._start, News(voice_of(self._published), own, own - self._start), news)
        return merged if np.isfinite(merged).all() else None

    def _news(self, size: int) -> Iterator[News]:
        """Of those that have published since they were heard last. A network of another shape tells nothing."""
        versions = self._others.versions()
        self._heard = {it: heard for it, heard in self._heard.items() if it in versions}  # who has gone is forgotten
        for number, version in versions.items():
            before, known = self._heard.get(number, (0, None))
            if voice_of(version) == 0 or version == before:
                continue
            said = self._others.weights(number)
            if said is None or said.size != size + self.parameters:
                continue
            total = said[size:].copy()
            self._heard[number] = version, total
            if known is None and version == FIRST_UPDATE:
                known = np.zeros_like(total)
            if known is None or not np.array_equal(total, known):  # else it was read before it was announced
                change = None if known is None else total - known
                yield News(voice_of(version), said[: self.parameters], change, said[self.parameters : size])


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


def voice_of(publications: int) -> int:
    """How much one counts. The first publication is what an execution began with."""
    return min(publications - 1, FULL_VOICE)
