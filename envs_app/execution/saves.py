"""Saves: the checkpoints of a run, a folder each. The file system is the truth; the database only lists them.

A save is written under a name that no reader looks at, flushed to the disk, and renamed; a reader checks the model's SHA-256.
So a save that was cut in half, or half-way through a full disk, is never used: the next older good one is.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

MODEL, META = "model.zip", "meta.json"
LITTER_SECONDS = 600.0


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


class SaveStore:
    """The saves of one run."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def write(self, meta: SaveMeta, write_model: Callable[[Path], None]) -> str:
        """Make a save, atomically; returns its name. Raises OSError when the disk is full or the folder not writable."""
        meta.created_at = time.time()
        name = f"{meta.created_at:017.6f}-{meta.execution[:8]}-{meta.steps}"
        partial = self.folder / f".{name}"
        try:
            partial.mkdir(parents=True)
            write_model(partial / MODEL)
            meta.sha256 = _digest(partial / MODEL)
            (partial / META).write_text(json.dumps(asdict(meta)))
            for path in (partial / MODEL, partial / META, partial):
                _flush(path)
            partial.rename(self.folder / name)
            _flush(self.folder)
        except BaseException:
            shutil.rmtree(partial, ignore_errors=True)
            raise
        return name

    def names(self) -> list[str]:
        """The names of the saves, newest first; not yet checked."""
        if not self.folder.is_dir():
            return []
        return sorted((p.name for p in self.folder.iterdir() if not p.name.startswith(".")), reverse=True)

    def meta(self, name: str) -> SaveMeta | None:
        """What a save says of itself; None when it is damaged."""
        try:
            return SaveMeta(**json.loads((self.folder / name / META).read_text()))
        except (OSError, ValueError, TypeError):
            return None

    def metas(self) -> Iterator[tuple[str, SaveMeta]]:
        """The saves whose description can be read, newest first."""
        for name in self.names():
            if meta := self.meta(name):
                yield name, meta

    def model(self, name: str) -> Path:
        """The model of a save."""
        return self.folder / name / MODEL

    def choose(self, rule: str) -> tuple[str, SaveMeta] | None:
        """The newest good save, or with rule 'best' the good one with the highest recent mean return."""
        saves = list(self.metas())
        if rule == "best":
            saves.sort(
                key=lambda save: -float("inf") if save[1].mean_return is None else save[1].mean_return, reverse=True
            )
        return next((save for save in saves if self._is_good(*save)), None)

    def _is_good(self, name: str, meta: SaveMeta) -> bool:
        try:
            return _digest(self.model(name)) == meta.sha256
        except OSError:
            return False

    def prune(self, kept: int) -> None:
        """Keep the newest `kept` saves of each execution's last, 50 in all, and always the best one."""
        saves = list(self.metas())
        scored = [save for save in saves if save[1].mean_return is not None]
        best = max(scored, key=lambda save: save[1].mean_return or 0.0)[0] if scored else None
        counts: dict[str, int] = {}
        for index, (name, meta) in enumerate(saves):
            counts[meta.execution] = counts.get(meta.execution, 0) + 1
            if name != best and (counts[meta.execution] > kept or index >= max(kept, 50)):
                self.delete(name)
        self._clear_litter()

    def _clear_litter(self) -> None:
        """Remove what processes left that died while they wrote; another process may do so at the same time."""
        for litter in self.folder.glob(".*"):
            with suppress(FileNotFoundError):
                if time.time() - litter.stat().st_mtime > LITTER_SECONDS:
                    shutil.rmtree(litter, ignore_errors=True)

    def delete(self, name: str) -> None:
        """Remove a save; out of sight first, so that nobody reads half of it."""
        hidden = self.folder / f".{name}.deleted"
        try:
            (self.folder / name).rename(hidden)
        except OSError:
            return  # somebody else was quicker
        shutil.rmtree(hidden, ignore_errors=True)


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _flush(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
