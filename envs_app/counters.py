"""Counters that all web processes share, for throttles: `add(name, seconds)` counts how often a name came in a span of time.

With REDIS_URL they are in Django's cache, which is Redis, and hold across machines. Without it there is one machine, and
they are in a file that its web processes map into memory: counting takes some microseconds, and writes to no database.
"""

from __future__ import annotations

import fcntl
import mmap
import os
import struct
from functools import lru_cache
from hashlib import blake2b
from pathlib import Path
from threading import Lock
from time import time as now
from typing import Protocol

import redis
import structlog
from django.conf import settings
from django.core.cache import cache

log = structlog.get_logger("shepherd.http")


class Counters(Protocol):
    """What both are."""

    def add(self, name: str, seconds: float) -> int:
        """How often the name came, with this time, in the span of `seconds` that the clock is in."""


class CacheCounters:
    """In Django's cache. While it cannot be reached nothing is counted, and so nobody is throttled."""

    def add(self, name: str, seconds: float) -> int:
        """See Counters. Two round trips; three for the first one in a span."""
        key = f"count:{name}:{int(now() // seconds)}"
        try:
            try:
                return cache.incr(key)
            except ValueError:  # the first one; of several at once, all but one find it there
                return 1 if cache.add(key, 1, seconds + 1) else cache.incr(key)
        except redis.RedisError as error:
            log.warning("throttles do not count", reason=str(error))
            return 0


class FileCounters:
    """A table in a file. A name's place follows from its hash; where two names have the same, the later one drives the earlier
    one out, which then counts from 0 again: of thousands of addresses a few get away with more, and the file never grows.
    """

    SLOTS = 65_536
    ROW = struct.Struct("<QLL")  # the name's hash, the number of its span of time, how often it came

    def __init__(self, path: Path) -> None:
        self._lock = Lock()  # between threads; `lockf` is between processes
        self._file = None
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("a+b")
            os.posix_fallocate(
                self._file.fileno(), 0, self.SLOTS * self.ROW.size
            )  # a hole would be fatal on a full disk
            self._table = mmap.mmap(self._file.fileno(), self.SLOTS * self.ROW.size)
        except OSError as error:
            log.warning("throttles count in this process alone", reason=str(error))
            self._file = None
            self._table = mmap.mmap(-1, self.SLOTS * self.ROW.size)

    def add(self, name: str, seconds: float) -> int:
        """See Counters."""
        mark = int.from_bytes(blake2b(name.encode(), digest_size=8).digest(), "little")
        span = int(now() // seconds)
        at = mark % self.SLOTS * self.ROW.size
        with self._lock:
            if self._file:
                fcntl.lockf(self._file, fcntl.LOCK_EX, self.ROW.size, at)
            try:
                known, counted, count = self.ROW.unpack_from(self._table, at)
                count = count + 1 if (known, counted) == (mark, span) else 1
                self.ROW.pack_into(self._table, at, mark, span, count)
            finally:
                if self._file:
                    fcntl.lockf(self._file, fcntl.LOCK_UN, self.ROW.size, at)
        return count


def get_counters() -> Counters:
    """Those that the settings ask for."""
    return _counters(bool(settings.REDIS_URL), Path(settings.DATA_DIR) / "run" / "counters")


@lru_cache(maxsize=1)
def _counters(shared: bool, path: Path) -> Counters:
    return CacheCounters() if shared else FileCounters(path)
