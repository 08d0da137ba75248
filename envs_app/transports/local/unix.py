"""Unix sockets by path, also where the path is longer than the 107 bytes that the kernel takes."""

from __future__ import annotations

import os
import socket
from pathlib import Path

LONGEST = 100


def listen(path: Path, backlog: int = 128) -> socket.socket:
    """A listening socket at `path`; a stale file there is replaced."""
    path.unlink(missing_ok=True)
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    _with_short_name(path, listener.bind)
    listener.listen(backlog)
    return listener


def connect(path: Path, timeout: float | None = None) -> socket.socket:
    """A connection to `path`. Raises ConnectionError when nobody listens there."""
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    connection.settimeout(timeout)
    try:
        _with_short_name(path, connection.connect)
    except FileNotFoundError as error:
        connection.close()
        raise ConnectionRefusedError(f"nobody listens at {path.name}") from error
    except BaseException:
        connection.close()
        raise
    return connection


def _with_short_name(path: Path, call: object) -> None:
    """Call with the path, or with a short name of it through a descriptor of its folder."""
    assert callable(call)
    if len(os.fsencode(path)) <= LONGEST:
        call(str(path))
        return
    folder = os.open(path.parent, os.O_PATH | os.O_DIRECTORY)
    try:
        call(f"/proc/self/fd/{folder}/{path.name}")
    finally:
        os.close(folder)
