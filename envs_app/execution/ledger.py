"""What must outlive an execution: where each of its sessions stands, and the last answer that each was given.

A ledger entry is written before the answer leaves. So whoever serves the session next, after whatever happened, knows which
steps were answered, repeats the last answer when asked, and goes on with the episode's sum.
"""

from __future__ import annotations

import errno
import mmap
import os
import struct
import zlib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Protocol

import msgpack


@dataclass(slots=True)
class SessionState:
    """Where a session stands."""

    owner: str = ""  # uid of the execution that serves it
    seq: int | None = None  # of the last answered step
    request: str = ""  # of the last answered step: the web process's own number for it
    reply: dict[str, Any] | None = None  # the last answer
    in_episode: bool = False
    episode: int = 0  # counts from 1; the one that runs, or the last one
    sum: float = 0.0  # of the rewards of the episode
    length: int = 0
    began: float = 0.0  # when its first action was chosen, in seconds since the epoch


FIELDS = tuple(field.name for field in fields(SessionState))


class Ledger(Protocol):
    """Keeps the states of sessions where kill -9 of an execution does not reach them."""

    def load(self, session: int) -> SessionState:
        """The state; a blank one for a session that never stepped."""
        ...

    def store(self, session: int, state: SessionState) -> None:
        """Keep the state."""
        ...

    def close(self, session: int) -> None:
        """Let go of what is open for the session; its state stays."""
        ...


class FileLedger:
    """A small file per session, with two slots that are written in turn, so that one is always whole.

    The files are mapped into memory: a write survives the death of the process, costs microseconds, and no system call in
    which the learner could take the interpreter. Their blocks are reserved, so that a full disk is an error at the opening.
    """

    HEADER = struct.Struct("!III")  # checksum, length, generation
    OPEN = 256  # files

    def __init__(self, folder: Path, slot: int = 4096) -> None:
        """`slot`: bytes that a state may take; one that is larger is kept in memory only."""
        self.folder, self.slot = folder, slot
        self._open: dict[int, mmap.mmap] = {}
        self._homeless: dict[int, SessionState] = {}  # while the disk is full: better than no answer

    def load(self, session: int) -> SessionState:
        """The newest whole slot."""
        if session in self._homeless:
            return self._homeless[session]
        try:
            _, body = self._newest(self._open.get(session) or self._open_file(session, 0))
        except OSError:
            return SessionState()
        return SessionState(**msgpack.unpackb(body)) if body else SessionState()

    def store(self, session: int, state: SessionState) -> None:
        """Write the other slot; on a full disk, keep the state in memory until it can be written."""
        try:
            self._write(session, state)
            self._homeless.pop(session, None)
        except OSError:
            self._homeless[session] = state

    def close(self, session: int) -> None:
        """Close its file."""
        if opened := self._open.pop(session, None):
            opened.close()

    def _write(self, session: int, state: SessionState) -> None:
        file = self._open.get(session) or self._open_file(session)
        generation = (self._newest_slot(file)[0] + 1) & 0xFFFFFFFF
        body = msgpack.packb({name: getattr(state, name) for name in FIELDS})
        size = self.HEADER.size + len(body)
        if size > self.slot:
            raise OSError(errno.EFBIG, "the state does not fit the ledger's slot")
        start = self.slot * (generation % 2)
        file[start : start + size] = self.HEADER.pack(zlib.crc32(body), len(body), generation) + body

    def _open_file(self, session: int, flags: int = os.O_CREAT) -> mmap.mmap:
        self.folder.mkdir(parents=True, exist_ok=True)
        while len(self._open) >= self.OPEN:
            self.close(next(iter(self._open)))
        descriptor = os.open(self.folder / str(session), os.O_RDWR | flags, 0o600)
        try:
            os.posix_fallocate(descriptor, 0, 2 * self.slot)
            opened = self._open[session] = mmap.mmap(descriptor, 2 * self.slot)
        finally:
            os.close(descriptor)
        return opened

    def _newest(self, file: mmap.mmap) -> tuple[int, bytes]:
        """Generation and body of the newest whole slot; 0 and nothing for a new file."""
        generation, slot = self._newest_slot(file)
        return (generation, self._body(file, slot)) if generation else (0, b"")

    def _newest_slot(self, file: mmap.mmap) -> tuple[int, int]:
        headers = [self.HEADER.unpack_from(file, self.slot * slot) for slot in (0, 1)]
        for slot in sorted((0, 1), key=lambda slot: headers[slot][2], reverse=True):
            checksum, length, generation = headers[slot]
            if generation and length <= self.slot and zlib.crc32(self._body(file, slot)) == checksum:
                return generation, slot
        return 0, 0

    def _body(self, file: mmap.mmap, slot: int) -> bytes:
        start = self.slot * slot
        _, length, _ = self.HEADER.unpack_from(file, start)
        return file[start + self.HEADER.size : start + self.HEADER.size + length]
