"""A storage of Django's that has files and no paths, as an object store has: for tests that nothing relies on a folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from django.core.files.base import File
from django.core.files.storage import FileSystemStorage, Storage


class Pathless(Storage):
    """What it keeps lies in a folder that only it knows; `path()` is Django's refusal."""

    def __init__(self, location: str | Path) -> None:
        self._files = FileSystemStorage(location)

    def _open(self, name: str, mode: str = "rb") -> File:
        return self._files.open(name, mode)

    def _save(self, name: str, content: File) -> str:
        return self._files.save(name, content)

    def exists(self, name: str) -> bool:
        """Whether there is such a file."""
        return self._files.exists(name)

    def listdir(self, path: str) -> tuple[list[str], list[str]]:
        """Folders and files; none where nothing is, as in a bucket."""
        return self._files.listdir(path) if self._files.exists(path) else ([], [])

    def delete(self, name: str) -> None:
        """A file; of folders an object store knows nothing, but here they are real."""
        self._files.delete(name)

    def size(self, name: str) -> Any:
        """Bytes."""
        return self._files.size(name)
