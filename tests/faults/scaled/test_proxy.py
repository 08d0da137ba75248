"""Two web machines behind the repository's nginx.conf, over TLS: one after the other is restarted, and one is killed."""

from __future__ import annotations

import os
import shutil
import signal
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.faults.conftest import AGENTS, create_agents
from tests.faults.players import playing
from tests.faults.scaled.setup import Scaled, running_scaled
from tests.proxies import Nginx
from tests.servers import Server
from tests.services import free_port, running

pytestmark = [pytest.mark.service, pytest.mark.long]

SETTINGS = {"SHEPHERD_TLS": 1, "SHEPHERD_SECRET_KEY": "x" * 50}


class WebMachine:
    """`manage.py serve` for the web alone, at one port whenever it is started."""

    def __init__(self, core: Scaled) -> None:
        self.data = Path(tempfile.mkdtemp(prefix="shepherd-web-"))
        own = {name: core.environment[name] for name in ("REDIS_URL", "DATABASE_URL", "SHEPHERD_DATABASE_POOL")}
        self.environment = own | SETTINGS | {"PORT": free_port(), "SHEPHERD_WEB_WORKERS": 1}
        self.start()

    def start(self) -> None:
        """Serve."""
        self.server = Server(self.data, self.environment)
        self.server.wait_until_ready()

    def restart(self) -> None:
        """In order, as for a new version."""
        assert self.server.end() == []
        self.start()

    def kill(self) -> None:
        """With all its processes, as when a machine is switched off."""
        for process in self.server.processes():
            process.kill()
        self.server.process.wait()

    def end(self) -> None:
        """Leave nothing behind."""
        self.server.end()
        shutil.rmtree(self.data, ignore_errors=True)


@pytest.fixture(scope="module")
def core() -> Iterator[Scaled]:
    """The workers and the housekeeping; its own web is not behind the proxy."""
    with running_scaled("--webs=1", **SETTINGS) as server:
        yield server


@pytest.fixture
def webs(core: Scaled) -> Iterator[list[WebMachine]]:
    """The two."""
    made: list[WebMachine] = []
    try:
        for _ in range(2):
            made.append(WebMachine(core))
        yield made
    finally:
        for web in made:
            web.end()


@pytest.fixture
def proxy(webs: list[WebMachine], monkeypatch: pytest.MonkeyPatch) -> Iterator[Nginx]:
    """Before them, and trusted."""
    with running(Nginx(*(f"127.0.0.1:{web.environment['PORT']}" for web in webs))) as nginx:
        monkeypatch.setenv("SSL_CERT_FILE", str(nginx.certificate))
        yield nginx


def test_a_web_machine_after_the_other_is_restarted_and_one_is_killed(
    core: Scaled, webs: list[WebMachine], proxy: Nginx
) -> None:
    _, key = create_agents(core, {"behind": AGENTS["killed"]})["behind"]
    with playing(core, key, url=proxy.url) as players:
        for web in webs:
            web.restart()
            players.play_on()
        assert {refusal.status for refusal in players.refused()} <= {503}
        os.kill(webs[0].server.web_pids()[0], signal.SIGKILL)
        players.play_on()
        webs[0].kill()
        players.play_on()
        assert {refusal.status for refusal in players.refused()} <= {503}
