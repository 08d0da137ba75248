"""Saves: the checkpoints of a run, in any storage. The storage is the truth; the database only lists them.

A save is two files, a model and its description with the model's SHA-256, and the description is written last: it makes the save.
So one that was cut in half, or half-way through a full disk, is never used: the next older good one is. Nothing else is
asked of a storage, no renaming and no locks, so that a bucket does as well as a folder.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from io import BytesIO
from typing import Any, NamedTuple

from envs_app.execution.storage import Storage

MODEL, META = "model.zip", "meta.json"
LITTER_SECONDS = 600.0
TICK = 1e-6  # seconds, the last digit of the time in a name
MOST = 50  # saves of a run


@dataclass
class SaveMeta:
    """What a save says of itself."""

    execution: str  # uid
    number: int  # of the execution
    steps: int
    updates: int
    episodes: int
    mean_return: float | None
    recent_returns: list[float] = field(default_factory=list)  # of at most 100 episodes
    extra: dict[str, Any] = field(default_factory=dict)
    created_at: float = 0.0  # seconds since the epoch
    sha256: str = ""
    knows: int = 0  # as averaging.py counts it
    idle: float = 0.0  # seconds between the last step that was learned from and the save

    @property
    def learned_at(self) -> float:
        """When it learned last. An execution that nobody uses any more is saved as it ends, which makes it no newer."""
        return self.created_at - self.idle


class Chosen(NamedTuple):
    """A good save."""

    name: str
    meta: SaveMeta
    model: BytesIO


class SaveStore:
    """The saves of one run: what lies below `prefix` in a storage."""

    def __init__(self, storage: Storage, prefix: str) -> None:
        self.storage, self.prefix = storage, prefix
        self._metas: dict[str, SaveMeta] = {}  # they never change, and a storage may be far away

    def write(self, meta: SaveMeta, write_model: Callable[[BytesIO], None]) -> str:
        """Make a save, atomically; returns its name. Raises OSError (disk full, folder not writable) or the storage's own."""
        model = BytesIO()
        write_model(model)
        meta.created_at, meta.sha256 = self._next_time(), _digest(model)
        name = f"{meta.created_at:017.6f}-{meta.execution[:8]}-{meta.steps}"
        try:
            self.storage.save(self._path(name, MODEL), model)
            self.storage.save(self._path(name, META), BytesIO(json.dumps(asdict(meta)).encode()))
        except BaseException:
            with suppress(Exception):  # what made it fail counts
                self.delete(name)
            raise
        return name

    def _next_time(self) -> float:
        """Now; or just after the newest save, where a clock was set back or another machine's is ahead: names tell the order."""
        newest = max((time_in(name) for name in self.names()), default=0.0)
        return max(time.time(), newest + TICK)

    def names(self) -> list[str]:
        """The names of the saves, newest first; not yet checked, nor known to be whole."""
        names = sorted((name for name in self._list("")[0] if not name.startswith(".")), reverse=True)
        self._metas = {name: self._metas[name] for name in names if name in self._metas}  # others delete some, too
        return names

    def meta(self, name: str) -> SaveMeta | None:
        """What a save says of itself; None when it is damaged, or not whole."""
        if name not in self._metas:
            try:
                self._metas[name] = SaveMeta(**json.loads(self._read(name, META)))
            except (OSError, ValueError, TypeError):
                return None
        return self._metas[name]

    def metas(self) -> Iterator[tuple[str, SaveMeta]]:
        """The saves whose description can be read, what learned last first; no more are read than it takes to know that."""
        read: list[tuple[str, SaveMeta]] = []
        for name in self.names():
            yield from _taken(
                read, time_in(name)
            )  # this one and those that follow learned no later than they were made
            if meta := self.meta(name):
                read.append((name, meta))
        yield from _taken(read, -math.inf)

    def size(self, name: str) -> int:
        """Bytes of its model; 0 when it has just gone."""
        with suppress(FileNotFoundError):
            return self.storage.size(self._path(name, MODEL))
        return 0

    def choose(self, rule: str) -> Chosen | None:
        """The newest good save, or with rule 'best' the good one with the highest recent mean return."""
        saves = self.metas()
        if rule == "best":
            saves = iter(sorted(saves, key=lambda save: _merit(save[1]), reverse=True))
        return next((good for save in saves if (good := self._checked(*save))), None)

    def _checked(self, name: str, meta: SaveMeta) -> Chosen | None:
        try:
            model = BytesIO(self._read(name, MODEL))
        except OSError:
            return None
        return Chosen(name, meta, model) if _digest(model) == meta.sha256 else None

    def prune(self, kept: int) -> None:
        """Keep the newest `kept` saves of each execution's last, 50 in all, and always the best one."""
        saves = list(self.metas())
        scored = [save for save in saves if save[1].mean_return is not None]
        best = max(scored, key=lambda save: _merit(save[1]))[0] if scored else None
        counts: dict[str, int] = {}
        for index, (name, meta) in enumerate(saves):
            counts[meta.execution] = counts.get(meta.execution, 0) + 1
            if name != best and (counts[meta.execution] > kept or index >= max(kept, MOST)):
                self.delete(name)
        self._clear_litter()

    def _clear_litter(self) -> None:
        """Remove what processes left that died while they wrote; a save's name begins with its time."""
        for name in self.names():
            old = 0.0 < time_in(name) < time.time() - LITTER_SECONDS
            if old and self.meta(name) is None and META not in self._list(name)[1]:
                self.delete(name)

    def delete(self, name: str) -> None:
        """Remove a save: first what makes it one, so that nobody reads half of it. Another process may do the same."""
        self._metas.pop(name, None)
        self.storage.delete(self._path(name, META))
        for file in self._list(name)[1]:
            self.storage.delete(self._path(name, file))
        self.storage.delete(self._path(name))

    def _path(self, *parts: str) -> str:
        return "/".join((self.prefix, *parts))

    def _list(self, name: str) -> tuple[list[str], list[str]]:
        try:
            return self.storage.listdir(self._path(name) if name else self.prefix)
        except (FileNotFoundError, NotADirectoryError):
            return [], []

    def _read(self, name: str, file: str) -> bytes:
        with self.storage.open(self._path(name, file)) as opened:
            return opened.read()


def _taken(read: list[tuple[str, SaveMeta]], since: float) -> Iterator[tuple[str, SaveMeta]]:
    """Take out those that learned since then, the last first; of equals the newest save."""
    read.sort(key=lambda save: (save[1].learned_at, save[0]))
    while read and read[-1][1].learned_at >= since:
        yield read.pop()


def time_in(name: str) -> float:
    """When a save was made, in seconds since the epoch, as its name says; 0 for what is no name of a save."""
    try:
        return float(name.partition("-")[0])
    except ValueError:
        return 0.0


def _merit(meta: SaveMeta) -> float:
    return -float("inf") if meta.mean_return is None else meta.mean_return


def _digest(model: BytesIO) -> str:
    return hashlib.sha256(model.getbuffer()).hexdigest()
