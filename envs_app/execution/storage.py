"""Where saves lie: any storage of Django's (STORAGES), of which this names the part that is used; and a folder, without Django.

Executions of the embedded set-up have no Django, and a save in a folder shall outlive a power failure, which
FileSystemStorage does not promise: so `Folder` is the default of both sides. Names are paths with `/` between their parts.
"""

from __future__ import annotations

import os
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import IO, Any, Protocol


class Storage(Protocol):
    """What saves ask of a storage, as Django defines it; whatever its library raises means that it cannot be reached."""

    def save(self, name: str, content: Any) -> str:
        """Keep what the file `content` holds under a name that is new."""

    def open(self, name: str) -> AbstractContextManager[IO[bytes]]:
        """What is kept under a name. Raises FileNotFoundError."""

    def listdir(self, path: str) -> tuple[list[str], list[str]]:
        """The folders and the files there. An empty list or FileNotFoundError: there are none."""

    def delete(self, name: str) -> None:
        """Forget a file, or a folder that is empty; nothing happens if it is not there."""

    def size(self, name: str) -> int:
        """Bytes of a file."""


class Folder:
    """A folder on a disk. What `save` has returned from is on the disk, and not only in its cache. Raises OSError."""

    def __init__(self, location: str | Path) -> None:
        self.location = Path(location)

    def save(self, name: str, content: IO[bytes]) -> str:
        """Write a file, and flush it and the folders that lead to it."""
        path = self.location / name
        path.parent.mkdir(parents=True, exist_ok=True)
        content.seek(0)
        with path.open("xb") as file:
            file.write(content.read())
            file.flush()
            os.fsync(file.fileno())
        for folder in (path.parent, path.parent.parent):
            _flush(folder)
        return name

    def open(self, name: str) -> IO[bytes]:
        """The file, to read."""
        return (self.location / name).open("rb")

    def listdir(self, path: str) -> tuple[list[str], list[str]]:
        """Its folders and files."""
        with os.scandir(self.location / path) as entries:
            kinds = [(entry.is_dir(), entry.name) for entry in entries]
        return [name for folder, name in kinds if folder], [name for folder, name in kinds if not folder]

    def delete(self, name: str) -> None:
        """Remove a file or an empty folder."""
        path = self.location / name
        with suppress(FileNotFoundError):  # another process was quicker
            path.rmdir() if path.is_dir() else path.unlink()

    def size(self, name: str) -> int:
        """Bytes."""
        return (self.location / name).stat().st_size


def _flush(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
