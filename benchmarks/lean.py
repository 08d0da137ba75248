"""A client that costs as little as Python allows, so that what is measured is the server: one socket, kept open."""

from __future__ import annotations

import socket
from typing import Any
from urllib.parse import urlsplit

import orjson

END = b"\r\n\r\n"


class Refused(RuntimeError):
    """The server answered with something else than 2xx."""

    def __init__(self, status: int, body: bytes) -> None:
        super().__init__(f"{status}: {body[:300]!r}")
        self.status, self.body = status, body


class Wire:
    """Sends one request after the other over one connection, with TCP_NODELAY."""

    def __init__(self, url: str, timeout: float = 60.0) -> None:
        parts = urlsplit(url)
        assert parts.hostname and parts.port
        self.host = parts.netloc
        self.socket = socket.create_connection((parts.hostname, parts.port), timeout)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def head(self, method: str, path: str, key: str = "") -> bytes:
        """The request but for its length and body; made once."""
        authorization = f"Authorization: Bearer {key}\r\n" if key else ""
        kind = "Content-Type: application/json\r\n" if method == "POST" else ""
        return f"{method} {path} HTTP/1.1\r\nHost: {self.host}\r\n{authorization}{kind}".encode()

    def exchange(self, head: bytes, body: bytes = b"") -> bytes:
        """The body of the answer. Raises Refused."""
        length = b"Content-Length: %d\r\n" % len(body) if body else b""
        self.socket.sendall(head + length + b"\r\n" + body)
        return self._receive()

    def close(self) -> None:
        """Close the connection."""
        self.socket.close()

    def _receive(self) -> bytes:
        data = self._more()
        while (end := data.find(END)) < 0:
            data += self._more()
        size, end = _length(data[:end]), end + len(END)
        while len(data) < end + size:
            data += self._more()
        status, body = int(data[9:12]), data[end : end + size]
        if not 200 <= status < 300:
            raise Refused(status, body)
        return body

    def _more(self) -> bytes:
        data = self.socket.recv(65536)
        if not data:
            raise ConnectionError("the server closed the connection")
        return data


class LeanSession:
    """A session of the HTTP API."""

    def __init__(self, url: str, api_key: str, wire: Wire | None = None) -> None:
        """`wire`: a connection that it shares with other sessions of this thread."""
        self.wire = wire or Wire(url)
        reply = orjson.loads(self.wire.exchange(self.wire.head("POST", "/api/v1/sessions", api_key), b"{}"))
        self.agent, self.key, self.seq = reply["agent"], reply["session_key"], 0
        self._step = self.wire.head("POST", "/api/v1/step", self.key)

    def step(self, obs: Any, reward: float = 0.0, terminated: bool = False, truncated: bool = False) -> dict[str, Any]:
        """The reply to a step."""
        self.seq += 1
        payload = {"obs": obs, "reward": reward, "terminated": terminated, "truncated": truncated, "seq": self.seq}
        return orjson.loads(self.wire.exchange(self._step, orjson.dumps(payload, option=orjson.OPT_SERIALIZE_NUMPY)))

    def close(self) -> None:
        """End the session."""
        self.wire.exchange(self.wire.head("DELETE", "/api/v1/session", self.key))
        self.wire.close()


class LeanHealth:
    """Asks /healthz, which does nothing: the fastest that this server and this client can be."""

    def __init__(self, url: str) -> None:
        self.wire = Wire(url)
        self._head = self.wire.head("GET", "/healthz")

    def ask(self) -> dict[str, Any]:
        """The reply."""
        return orjson.loads(self.wire.exchange(self._head))

    def close(self) -> None:
        """Close the connection."""
        self.wire.close()


def _length(head: bytes) -> int:
    for line in head.lower().split(b"\r\n"):
        if line.startswith(b"content-length:"):
            return int(line[15:])
    return 0
