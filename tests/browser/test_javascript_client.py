"""The JavaScript client in a real browser, in a page from another origin than Shepherd's."""

from __future__ import annotations

import functools
import json
import threading
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from selenium import webdriver
from selenium.webdriver.support.ui import WebDriverWait

from tests.clients.driving import PROJECT
from tests.clients.proxy import Answer, Cut, Proxy
from tests.servers import Server

pytestmark = pytest.mark.browser

PAGE = """<!doctype html>
<title>waiting</title>
<script type="module">
  import { Client, InvalidApiKey, InvalidObservation } from "./shepherd-client.js";

  const { key, url } = JSON.parse(decodeURIComponent(location.hash.slice(1)));
  const obs = new Float32Array([0.25, -0.5, 0, 1.5]);
  const seen = { origin: location.origin };
  try {
    const session = await new Client(key, { url }).session();
    seen.agent = session.agent;
    seen.action = await session.act(obs);
    await session.observe(obs, 1);
    seen.refusal = await session.step([1]).catch((error) => error instanceof InvalidObservation && error.message);
    seen.second = await session.act(obs);
    seen.total = await session.observe(obs, 2, { terminated: true });
    seen.seq = session.seq;
    await session.close();
    seen.wrongKey = await new Client("sk_wrong", { url }).session().catch((error) => error instanceof InvalidApiKey);
  } catch (error) {
    seen.error = `${error.name}: ${error.message}`;
  }
  document.title = JSON.stringify(seen);
</script>
"""


class QuietHandler(SimpleHTTPRequestHandler):
    """Serves files without a word."""

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing."""


@pytest.fixture(scope="module")
def key(server: Server) -> str:
    """The API key of an agent."""
    return server.create_agent(name="browser: client")[1]


@pytest.fixture
def page(tmp_path: Path) -> Iterator[str]:
    """The URL of a page that is somebody else's, with a copy of the module beside it."""
    (tmp_path / "index.html").write_text(PAGE)
    (tmp_path / "shepherd-client.js").write_text((PROJECT / "clients/javascript/shepherd-client.js").read_text())
    files = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(QuietHandler, directory=str(tmp_path)))
    threading.Thread(target=files.serve_forever, daemon=True).start()
    yield f"http://localhost:{files.server_port}/"
    files.shutdown()
    files.server_close()


def play(browser: webdriver.Chrome, page: str, key: str, url: str) -> dict[str, Any]:
    """What the page saw."""
    browser.get("about:blank")
    browser.get(f"{page}#{json.dumps({'key': key, 'url': url})}")
    WebDriverWait(browser, 60).until(lambda driver: driver.title.startswith("{"))
    return json.loads(browser.title)


def test_a_page_from_another_origin_plays_an_episode(
    browser: webdriver.Chrome, page: str, server: Server, key: str
) -> None:
    seen = play(browser, page, key, server.url)
    assert "error" not in seen, seen
    assert not server.url.startswith(seen["origin"])
    assert seen["agent"]["action_space"] == 2
    assert {seen["action"], seen["second"]} <= {0, 1}
    assert "4" in seen["refusal"]
    assert (seen["total"], seen["seq"]) == (3, 3)
    assert seen["wrongKey"] is True


def test_lost_replies_and_requests_to_wait_do_no_harm(
    browser: webdriver.Chrome, page: str, server: Server, key: str
) -> None:
    wait = Answer(
        503, {"Retry-After": "1", "Access-Control-Allow-Origin": "*"}, b'{"code": "no_capacity", "detail": "-"}'
    )
    with Proxy(server.url) as proxy:
        proxy.faults.extend([Cut.REPLY, Cut.REQUEST, wait, Cut.HALF_REPLY])
        seen = play(browser, page, key, proxy.url)
        assert not proxy.faults
    assert "error" not in seen, seen
    assert (seen["total"], seen["seq"]) == (3, 3)


def test_a_publishable_key_works_in_its_page_and_in_no_other(
    browser: webdriver.Chrome, page: str, server: Server
) -> None:
    own = page.rstrip("/")
    spaces = ("--action-space=2", "--observation-space=[[4], -1, 1]")
    made = [
        json.loads(server.make("create_agent", "--owner=web", f"--name={name}", "--algorithm=PPO", *spaces, *origin))
        for name, origin in (("page", [f"--origin={own}"]), ("another page", ["--origin=https://example.org"]))
    ]
    seen = play(browser, page, made[0]["publishable_key"], server.url)
    assert "error" not in seen, seen
    assert (seen["origin"], seen["total"]) == (own, 3)
    assert "Forbidden" in play(browser, page, made[1]["publishable_key"], server.url)["error"]
