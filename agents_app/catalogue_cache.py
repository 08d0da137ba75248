"""What was read from the algorithms' signatures, kept beside Python's own compiled files.

Reading them takes three seconds, as it loads torch, and each start of a server would take them. The file's name says what it was
read from; where it cannot be written, every start reads anew.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
LIBRARIES = ("stable-baselines3", "sb3-contrib")
SOURCES = ("catalogue*.py", "algorithms/*.py")

Read = dict[str, list[dict[str, Any]]]


def cached(read: Callable[[], Read], folder: Path = HERE / "__pycache__") -> Read:
    """What `read` returns, or returned when the code was the same."""
    path = folder / f"catalogue-{fingerprint()}.json"
    with suppress(OSError, ValueError):
        return json.loads(path.read_text())
    result = read()
    with suppress(OSError):
        _replace(path, json.dumps(result))
    return result


@cache
def fingerprint() -> str:
    """Of the sources and libraries that signatures and texts come from."""
    digest = hashlib.sha256(" ".join(map(version, LIBRARIES)).encode())
    for pattern in SOURCES:
        for source in sorted(HERE.glob(pattern)):
            digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def _replace(path: Path, text: str) -> None:
    """Write the file whole, and forget older ones."""
    path.parent.mkdir(exist_ok=True)
    for old in path.parent.glob("catalogue-*.json"):
        old.unlink(missing_ok=True)
    partial = path.with_suffix(f".{os.getpid()}.new")
    partial.write_text(text)
    partial.replace(path)
