"""An HTTP proxy that loses what it is told to lose.

with Proxy(server.url) as proxy:
    proxy.faults.append(Cut.REPLY)      # the next step reaches the server, its reply does not reach the client
    proxy.faults.append(Answer(503, {"Retry-After": "1"}, b"{}"))  # the step after it does not reach the server
"""

from __future__ import annotations

import enum
import http.client
import socket
import threading
from collections import deque
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import urlsplit

STEP = "/api/v1/step"
HOP_BY_HOP = {"connection", "keep-alive", "transfer-encoding", "content-length", "server", "date"}


class Cut(enum.Enum):
    """Where the connection to the client ends."""

    REQUEST = enum.auto()  # before the server got the request
    REPLY = enum.auto()  # after the server answered, before the client heard of it
    HALF_REPLY = enum.auto()  # in the middle of the reply's body


@dataclass(frozen=True)
class Answer:
    """A reply that the server did not make."""

    status: int
    headers: dict[str, str] = field(default_factory=dict)
    body: bytes = b""


class Proxy:
    """Hands requests on to `target`, one fault per step for as long as there are `faults`."""

    def __init__(self, target: str) -> None:
        self.target = target
        self.faults: deque[Cut | Answer] = deque()
        self.steps = 0  # how often a client sent a step, whatever became of it
        self.connections = 0
        handler = type("BoundHandler", (Handler,), {"proxy": self})
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
        self._thread = threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True)

    @property
    def url(self) -> str:
        """Where clients reach it."""
        return f"http://127.0.0.1:{self._server.server_port}"

    def __enter__(self) -> Proxy:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._server.shutdown()
        self._server.server_close()


class Handler(BaseHTTPRequestHandler):
    """One connection of a client."""

    proxy: Proxy
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True

    def setup(self) -> None:
        """A client has connected."""
        super().setup()
        self.proxy.connections += 1

    def handle_any(self) -> None:
        """Take one request, and the next fault if it is a step."""
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        fault = self._next_fault() if self.path == STEP else None
        if fault is Cut.REQUEST:
            return self._hang_up()
        answer = fault if isinstance(fault, Answer) else self._forward(body)
        if fault is Cut.REPLY:
            return self._hang_up()
        self._reply(answer, answer.body[: len(answer.body) // 2] if fault is Cut.HALF_REPLY else answer.body)
        return self._hang_up() if fault is Cut.HALF_REPLY else None

    do_GET = do_POST = do_DELETE = do_OPTIONS = handle_any

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing."""

    def _next_fault(self) -> Cut | Answer | None:
        self.proxy.steps += 1
        return self.proxy.faults.popleft() if self.proxy.faults else None

    def _forward(self, body: bytes) -> Answer:
        upstream = http.client.HTTPConnection(urlsplit(self.proxy.target).netloc, timeout=60)
        try:
            upstream.request(self.command, self.path, body or None, dict(self.headers))
            response = upstream.getresponse()
            headers = {name: value for name, value in response.getheaders() if name.lower() not in HOP_BY_HOP}
            return Answer(response.status, headers, response.read())
        except OSError:  # the server is being restarted
            return Answer(502)
        finally:
            upstream.close()

    def _reply(self, answer: Answer, body: bytes) -> None:
        self.send_response(answer.status)
        for name, value in answer.headers.items():
            self.send_header(name, value)
        if answer.status != 204:
            self.send_header("Content-Length", str(len(answer.body)))
        self.end_headers()
        self.wfile.write(body)

    def _hang_up(self) -> None:
        self.close_connection = True
        self.connection.shutdown(socket.SHUT_RDWR)
