"""`docker compose up --scale web=N`: the proxy asks Docker again and again where the web processes are.

Needs a newer nginx than Debian 12 has; the image in docker-compose.yml is new enough. So this alone is skipped in CI, too.
"""

from __future__ import annotations

import socket
import ssl
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from tests.proxies import RESOLVES, Nginx, nginx_version
from tests.servers import wait_for
from tests.services import free_port, running

FIRST, SECOND = "127.0.0.2", "127.0.0.3"


class Names(threading.Thread):
    """A DNS server that knows one name, whatever it is asked: these addresses, as Docker's knows a service."""

    def __init__(self, *addresses: str) -> None:
        super().__init__(daemon=True)
        self.addresses = list(addresses)
        self.socket = socket.socket(type=socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.start()

    @property
    def address(self) -> str:
        """Where it is asked."""
        return f"127.0.0.1:{self.socket.getsockname()[1]}"

    def run(self) -> None:
        """Answer."""
        while True:
            query, caller = self.socket.recvfrom(512)
            self.socket.sendto(self._answer(query), caller)

    def _answer(self, query: bytes) -> bytes:
        """All addresses to a question for IPv4 (type A, 1), none to another (RFC 1035)."""
        end = query.index(b"\0", 12) + 5  # of the question: the name, its type, its class
        addresses = self.addresses if query[end - 3] == 1 else []
        header = query[:2] + b"\x81\x80\0\x01" + len(addresses).to_bytes(2, "big") + b"\0\0\0\0"
        records = [b"\xc0\x0c\0\x01\0\x01\0\0\0\x01\0\x04" + socket.inet_aton(address) for address in addresses]
        return header + query[12:end] + b"".join(records)


class Teller(BaseHTTPRequestHandler):
    """Says at which address it was asked."""

    def do_GET(self) -> None:
        """Answer."""
        body = str(self.connection.getsockname()[0]).encode()
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""


@contextmanager
def telling(address: str, port: int) -> Iterator[None]:
    """A web process at an address."""
    server = ThreadingHTTPServer((address, port), Teller)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05})
    thread.start()
    try:
        yield
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def who_answer(proxy: Nginx) -> set[str]:
    """The web processes that ten requests come to; none while the proxy knows of none."""
    trust = ssl.create_default_context(cafile=str(proxy.certificate))
    with suppress(urllib.error.HTTPError):
        return {urllib.request.urlopen(proxy.url, context=trust, timeout=5).read().decode() for _ in range(10)}
    return set()


def test_web_processes_come_and_go() -> None:
    if nginx_version() < RESOLVES:
        pytest.skip(f"needs nginx {'.'.join(map(str, RESOLVES))} or newer")
    names, port = Names(FIRST), free_port()
    with ExitStack() as webs:
        for address in (FIRST, SECOND):
            webs.enter_context(telling(address, port))
        with running(Nginx(f":{port}", dns=names.address)) as proxy:
            wait_for(lambda: who_answer(proxy) == {FIRST}, 20, "the first")
            names.addresses.append(SECOND)
            wait_for(lambda: who_answer(proxy) == {FIRST, SECOND}, 20, "both")
            names.addresses.remove(FIRST)
            wait_for(lambda: who_answer(proxy) == {SECOND}, 20, "the second alone")
