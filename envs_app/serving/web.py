"""The web processes: granian on a listening socket that the supervisor opened.

The supervisor owns the socket, so while a killed web process starts again, connections wait in the socket's queue and
are not refused. Granian by itself opens a socket per worker and loses what waits in the queue of a worker that dies.
"""

import argparse
import os
import signal
import socket
from typing import Any

from granian._granian import SocketHolder
from granian.constants import HTTPModes, Interfaces
from granian.http import HTTP1Settings
from granian.server.mp import MPServer

from envs_app.serving.bond import die_with_parent

BACKLOG = 1024
CONNECTIONS = 8192  # per worker; granian lets further ones wait unanswered, so this is above any number of clients
IDLE_CONNECTION_MS = 120_000  # granian closes a connection on which no request came for so long


class Server(MPServer):
    """Granian on an inherited listening socket."""

    def __init__(self, fd: int, **options: Any) -> None:
        super().__init__("shepherd.wsgi:application", **options)
        self.fd = fd

    def _init_shared_socket(self) -> None:
        self._sso = socket.socket(fileno=self.fd)
        self.bind_addr, self.bind_port = self._sso.getsockname()[:2]  # for the log
        self._shd: Any = SocketHolder(self.fd, False, BACKLOG)  # type: ignore[call-arg]  # its stub lacks two


class Loader:
    """Loads the application in a worker; the worker is killed at once if granian's main process is."""

    def __init__(self) -> None:
        self.parent = os.getpid()

    def __call__(self) -> Any:
        """The WSGI application."""
        die_with_parent(self.parent, by=signal.SIGKILL)
        signal.signal(
            signal.SIGTERM, signal.SIG_DFL
        )  # else a worker that still loads inherits a handler that does nothing
        from shepherd.wsgi import application

        return application


def main() -> None:
    """Serve until SIGTERM; running requests are finished."""
    parser = argparse.ArgumentParser()
    for name in ("fd", "workers", "threads", "grace"):
        parser.add_argument(f"--{name}", type=int, required=True)
    options = parser.parse_args()
    server = Server(
        options.fd,
        interface=Interfaces.WSGI,
        http=HTTPModes.http1,
        http1_settings=HTTP1Settings(header_read_timeout=IDLE_CONNECTION_MS),
        workers=options.workers,
        blocking_threads=options.threads,
        backpressure=CONNECTIONS,
        respawn_failed_workers=True,
        workers_kill_timeout=options.grace,
        process_name="shepherd web",
    )
    server.serve(target_loader=Loader(), wrap_loader=False)


if __name__ == "__main__":
    main()
