"""The minibatches of a rollout, cut from one shuffled copy of it.

SB3 gathers each minibatch by its indices and copies it twice, array by array: a twelfth of an update of PPO with a small network
(docs/adr/0005). Here each epoch gathers the rollout once, in the order of the same permutation, and its minibatches are
slices of that: the same numbers, to the bit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from stable_baselines3.common.buffers import DictRolloutBuffer, RolloutBuffer

LARGEST_COPY = (
    2**22
)  # bytes of observations; above, as of images, gathering is little beside the network, and memory is not
Get = Callable[..., Iterator[Any]]


def slice_minibatches(buffer: RolloutBuffer) -> None:
    """Let this buffer's `get` slice, if it is one of SB3's own and small. Others, as of sequences, stay as they are."""
    if type(buffer) not in (RolloutBuffer, DictRolloutBuffer):
        return
    small = _size(buffer.observations) <= LARGEST_COPY
    buffer.get = _slicing(buffer.get) if small else _by_rows(buffer.get)  # type: ignore[method-assign, assignment]


class Rows(dict[str, Any]):
    """Observations of a dictionary, (B, ...) each, of which a slice takes rows: TRPO takes every n-th of them."""

    def __getitem__(self, key: Any) -> Any:
        """A part of the observations by its name, or some rows of all parts."""
        return super().__getitem__(key) if isinstance(key, str) else _cut(self, key)


def _slicing(get: Get) -> Get:
    def slices(batch_size: int | None = None) -> Iterator[Any]:
        (whole,) = get()
        count = len(whole.actions)
        size = batch_size or count
        for start in range(0, count, size):
            yield type(whole)(*(_cut(part, slice(start, start + size)) for part in whole))

    return slices


def _by_rows(get: Get) -> Get:
    def batches(batch_size: int | None = None) -> Iterator[Any]:
        for batch in get(batch_size):
            yield type(batch)(*(Rows(part) if isinstance(part, dict) else part for part in batch))

    return batches


def _cut(part: Any, where: slice) -> Any:
    """Of a tensor, or of each one of a dictionary, the rows."""
    if isinstance(part, dict):
        return Rows({key: tensor[where] for key, tensor in part.items()})
    return part[where]


def _size(observations: Any) -> int:
    """Bytes of the observations of a rollout."""
    return sum(array.nbytes for array in (observations.values() if isinstance(observations, dict) else [observations]))
