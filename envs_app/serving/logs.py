"""The logs of the supervisor's children: files in $SHEPHERD_DATA/logs, or the terminal's standard error."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import IO

LARGEST = 20 * 2**20  # bytes; a longer log becomes NAME.log.1, and the one before that is deleted


class Logs:
    """Opens the children's logs and keeps them short."""

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder  # None: standard error
        if folder:
            folder.mkdir(parents=True, exist_ok=True)

    def open(self, name: str) -> IO[bytes]:
        """Where the child `name` writes."""
        return self.path(name).open("ab", buffering=0) if self.folder else sys.stderr.buffer

    def path(self, name: str) -> Path:
        """The file of the child `name`."""
        return (self.folder or Path()) / f"{name}.log"

    def rotate(self) -> None:
        """Copy long logs away and empty them; the writers keep their open (appending) files."""
        for path in self.folder.glob("*.log") if self.folder else ():
            if path.stat().st_size > LARGEST:
                with path.open("rb") as log, path.with_suffix(".log.1").open("wb") as old:
                    old.writelines(log)
                with path.open("r+b") as log:
                    log.truncate(0)

    def tail(self, name: str, lines: int = 15) -> str:
        """The end of a log, for a message that says why the start failed."""
        if not self.folder:
            return ""
        with self.path(name).open("rb") as log:
            log.seek(max(0, self.path(name).stat().st_size - 8192))
            return "\n".join(log.read().decode(errors="replace").splitlines()[-lines:])
