"""What must hold before anything starts: a free port, room on the disk, and no other supervisor of the same data."""

from __future__ import annotations

import errno
import fcntl
import os
import resource
import shutil
import socket
import time
from pathlib import Path

import psutil

LEFTOVERS_SECONDS = 40  # how long the processes of a killed supervisor may take to save and end


class StartError(Exception):
    """Shepherd cannot start; the text says in one line why, and what to do."""


def check_disk(folder: Path, minimum_mb: int) -> None:
    """Raise StartError unless `folder` can be written, has room, and a path that Unix sockets can have."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".probe.{os.getpid()}"
        probe.write_bytes(b"\0" * 4096)
        probe.unlink()
    except OSError as error:
        raise StartError(
            f"{folder} cannot be written ({error.strerror}): set SHEPHERD_DATA to another folder."
        ) from None
    free = shutil.disk_usage(folder).free // 2**20
    if free < minimum_mb:
        raise StartError(
            f"the disk is full: {folder} has {free} MB free, and Shepherd wants {minimum_mb} MB. "
            "Make room, or set SHEPHERD_DATA to another folder."
        )


def listen(host: str, port: int) -> socket.socket:
    """A listening socket; port 0 takes a free one. Raises StartError with the reason when that fails."""
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
        listener = socket.socket(family)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # accepted connections inherit it
        listener.bind(address)
        listener.listen(1024)
    except (OSError, OverflowError) as error:
        raise StartError(_why_not(host, port, error)) from None
    return listener


def _why_not(host: str, port: int, error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number == errno.EADDRINUSE:
        return f"port {port} on {host} is taken: stop the other program, or choose another port (PORT={port + 1})."
    if number == errno.EACCES:
        return f"port {port} needs administrator rights: choose one above 1023, for example PORT=8000."
    return f"cannot listen on {host}:{port} ({error}): set HOST and PORT."


def lock(path: Path, wait: float = LEFTOVERS_SECONDS) -> int:
    """Lock the data folder and return the lock's file descriptor, which the children inherit.

    So the lock is held while any of them lives: after a kill -9 of a supervisor the next one waits until the executions
    have been saved. Raises StartError when another supervisor runs.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    fd = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    deadline = time.monotonic() + wait
    while not _try_lock(fd):
        if holder := _holder(fd):
            raise StartError(
                f"Shepherd already runs with this data (process {holder}, {path.parent.parent}): "
                "stop it, or set SHEPHERD_DATA to another folder."
            )
        if time.monotonic() > deadline:
            raise StartError(f"processes of an earlier Shepherd still use {path.parent.parent}: end them first.")
        time.sleep(0.1)
    os.ftruncate(fd, 0)
    os.pwrite(fd, _identity(os.getpid()), 0)
    return fd


def _try_lock(fd: int) -> bool:
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _identity(pid: int) -> bytes:
    """The process, told from a later one with the same number."""
    return f"{pid} {psutil.Process(pid).create_time():.2f}".encode()


def _holder(fd: int) -> int | None:
    """The supervisor that wrote itself into the lock file, if it still runs."""
    written = os.pread(fd, 100, 0)
    try:
        pid = int(written.split()[0])
        return pid if _identity(pid) == written else None
    except (IndexError, ValueError, psutil.NoSuchProcess):
        return None


def raise_file_limit() -> None:
    """Allow as many open files as the system lets us: each client is a connection, each execution a few sockets."""
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
