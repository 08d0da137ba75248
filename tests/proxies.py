"""The repository's nginx.conf in a real nginx, before web processes of a test.

    with running(Nginx("127.0.0.1:8000", "127.0.0.1:8001")) as proxy:
        httpx.get(f"{proxy.url}healthz", verify=str(proxy.certificate))

Only what a machine without Docker lacks is put in place of what the file says: ports, certificate, names.
"""

from __future__ import annotations

import os
import re
import shutil
import socket
import subprocess
from pathlib import Path

from tests.servers import PROJECT
from tests.services import PrivateServer, free_port, program

NAMED = "server web:8000 resolve fail_timeout=1s;"
DOCKER_DNS = "resolver 127.0.0.11"
RESOLVES = (1, 27, 3)  # the first nginx that asks for the addresses of a server again
AROUND = """
daemon off;
pid nginx.pid;
worker_processes 1;
events {{}}
http {{
    access_log off;
    client_body_temp_path body;
    proxy_temp_path replies;
    fastcgi_temp_path fastcgi;
    uwsgi_temp_path uwsgi;
    scgi_temp_path scgi;
    {site}
}}
"""


class Nginx(PrivateServer):
    """A proxy before `webs`, e.g. "127.0.0.1:8000". With `dns`, the address of a server that knows the name `web`, it asks
    that one for their addresses instead, and `webs` is the one port of them all, e.g. ":8000"."""

    owner = "www-data" if os.geteuid() == 0 else None  # as in its image, it is not root

    def __init__(self, *webs: str, dns: str | None = None) -> None:
        super().__init__()
        self.plain_port = free_port()
        self.certificate = self.folder / "tls.crt"
        _make_certificate(self.folder)
        (self.folder / "nginx.conf").write_text(AROUND.format(site=self._site(webs, dns)))
        if self.owner:
            for path in [self.folder, *self.folder.iterdir()]:
                shutil.chown(path, self.owner)

    @property
    def url(self) -> str:
        """Where it speaks TLS, with a slash at the end."""
        return f"https://127.0.0.1:{self.port}/"

    @property
    def plain_url(self) -> str:
        """Where it sends to `url` whoever comes without TLS."""
        return f"http://127.0.0.1:{self.plain_port}/"

    def command_line(self) -> list[str]:
        """With all its files in its folder."""
        return [program("nginx"), "-p", str(self.folder), "-c", str(self.folder / "nginx.conf"), "-e", "stderr"]

    def answers(self) -> bool:
        """Whether it listens."""
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0

    def _site(self, webs: tuple[str, ...], dns: str | None) -> str:
        servers = " ".join(f"server {web} fail_timeout=1s;" for web in webs)
        places = {
            "listen 8443 ssl": f"listen 127.0.0.1:{self.port} ssl",
            "listen 8080": f"listen 127.0.0.1:{self.plain_port}",
            "/run/secrets/tls.crt": str(self.certificate),
            "/run/secrets/tls.key": str(self.folder / "tls.key"),
            NAMED: NAMED.replace(":8000", webs[0]) if dns else servers,
            DOCKER_DNS: f"resolver {dns or '127.0.0.1'}",
        }
        site = (PROJECT / "nginx.conf").read_text()
        for written, here in places.items():
            assert site.count(written) == 1, f"nginx.conf has {written!r} {site.count(written)} times"
            site = site.replace(written, here)
        return site


def nginx_version() -> tuple[int, ...]:
    """That of the installed nginx. Skips the test if there is none."""
    said = subprocess.run([program("nginx"), "-v"], capture_output=True, text=True).stderr
    return tuple(map(int, re.findall(r"\d+", said)[:3]))


def _make_certificate(folder: Path) -> None:
    """One that only who is told to trusts."""
    names = ["-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1"]
    files = ["-keyout", str(folder / "tls.key"), "-out", str(folder / "tls.crt")]
    request = [program("openssl"), "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", *names, *files]
    subprocess.run(request, check=True, capture_output=True, timeout=60)
