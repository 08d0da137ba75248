"""The repository's nginx.conf in a real nginx, before a real server: what clients, browsers and strangers get through it."""

from __future__ import annotations

import json
import re
import ssl
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import psutil
import pytest
from shepherd_client import Client, RequestTooLarge, Unavailable

from envs_app.errors import RequestTooLarge as Large
from envs_app.errors import Unavailable as Away
from envs_app.problems import describe
from tests.browser.bored_page import HERE as HERE_IN_BRUSSELS
from tests.browser.bored_page import Visitor
from tests.browser.conftest import running_browser
from tests.faults.inside import HERE, play
from tests.proxies import Nginx
from tests.servers import Server, running_server
from tests.services import free_port, running

pytestmark = pytest.mark.service

ALL = "127.0.0.1"
SETTINGS = {"SHEPHERD_TLS": 1, "SHEPHERD_ALLOWED_HOSTS": ALL, "SHEPHERD_BORED_TILES": "", "SHEPHERD_BORED_ROUTING": ""}
MEBIBYTE = 2**20


@pytest.fixture(scope="module")
def web() -> Iterator[Server]:
    """A server behind TLS, which takes three wrong keys a minute."""
    with running_server(SHEPHERD_WRONG_KEYS=3, **SETTINGS) as server:
        yield server


@pytest.fixture(scope="module")
def demo(web: Server) -> dict[str, Any]:
    """Password and keys of the demo data."""
    return json.loads(web.make("demo_data"))


@pytest.fixture(scope="module")
def proxy(web: Server) -> Iterator[Nginx]:
    """Its proxy."""
    with running(Nginx(urlsplit(web.url).netloc)) as nginx:
        yield nginx


@pytest.fixture
def key(demo: dict[str, Any], proxy: Nginx, monkeypatch: pytest.MonkeyPatch) -> str:
    """The key of an agent, in a program that trusts the proxy."""
    monkeypatch.setenv("SSL_CERT_FILE", str(proxy.certificate))
    return demo["agents"][0]["api_key"]


def browser(proxy: Nginx, address: str = ALL, **headers: str) -> httpx.Client:
    """Somebody at an address of this machine, who trusts the proxy."""
    trust = ssl.create_default_context(cafile=str(proxy.certificate))
    way = httpx.HTTPTransport(verify=trust, local_address=address)
    return httpx.Client(transport=way, base_url=proxy.url, headers=headers)


def connections(proxy: Nginx, web: Server) -> set[int]:
    """Those that the proxy has to the server, by its ports."""
    port = urlsplit(web.url).port
    children = psutil.Process(proxy.process.pid).children()
    open_now = [c for child in children for c in child.net_connections() if c.raddr and c.raddr.port == port]
    return {connection.laddr.port for connection in open_now}


@pytest.fixture
def visitor(tmp_path: Path, proxy: Nginx, demo: dict[str, Any]) -> Iterator[Visitor]:
    """Somebody with a phone, who goes on though nobody vouches for the certificate."""
    with running_browser(tmp_path, "--ignore-certificate-errors") as chrome:
        yield Visitor(chrome, proxy.url).is_new().holds().is_at(HERE_IN_BRUSSELS)


def test_a_client_steps_over_tls_on_connections_that_stay_open(web: Server, proxy: Nginx, key: str) -> None:
    with Client(key, proxy.url) as client:
        session = client.session()
        play(session, 20)
        before = connections(proxy, web)
        play(session, 60)
        assert len(before) == 1
        assert connections(proxy, web) == before


def test_who_comes_without_tls_is_sent_to_it(proxy: Nginx) -> None:
    answer = httpx.get(f"{proxy.plain_url}bored/?lang=fr")
    assert answer.status_code == 308
    assert answer.headers["Location"] == f"https://{ALL}/bored/?lang=fr"
    assert httpx.post(f"{proxy.plain_url}api/v1/step").status_code == 308


@pytest.mark.parametrize("path", ["admin/login/", "bored/", "healthz", "api/v1/agent", "nowhere"])
def test_browsers_come_by_tls_only_from_then_on(proxy: Nginx, path: str) -> None:
    with browser(proxy) as somebody:
        answer = somebody.get(path)
    assert answer.headers["Strict-Transport-Security"].startswith("max-age=31536000")
    assert all("Secure" in cookie for cookie in answer.headers.get_list("Set-Cookie"))
    assert "nginx" not in answer.headers["Server"] or not re.search(r"\d", answer.headers["Server"])


def test_an_administrator_logs_in_at_whatever_port(proxy: Nginx, demo: dict[str, Any]) -> None:
    with browser(proxy, Origin=proxy.url.rstrip("/")) as boss:
        boss.get("admin/login/")
        form = {"username": demo["admin"]["name"], "password": demo["admin"]["password"]}
        form["csrfmiddlewaretoken"] = boss.cookies["csrftoken"]
        answer = boss.post("admin/login/?next=/admin/", data=form, headers={"Referer": f"{proxy.url}admin/login/"})
        assert (answer.status_code, answer.headers["Location"]) == (302, "/admin/")
        assert boss.get("admin/agents_app/agent/").status_code == 200


def test_who_logs_in_from_a_foreign_page_is_refused(proxy: Nginx, demo: dict[str, Any]) -> None:
    with browser(proxy, Origin="https://evil.example") as boss:
        boss.get("admin/login/")
        assert boss.post("admin/login/", data={"csrfmiddlewaretoken": boss.cookies["csrftoken"]}).status_code == 403


def test_a_page_of_the_server_uses_its_publishable_key(proxy: Nginx, demo: dict[str, Any]) -> None:
    with browser(proxy) as visitor:
        published = {"Authorization": f"Bearer {visitor.get('bored/config.json').json()['key']}"}
        own, foreign = {"Origin": proxy.url.rstrip("/")}, {"Origin": "https://evil.example"}
        assert visitor.post("api/v1/sessions", headers=published | own).status_code == 201
        assert visitor.post("api/v1/sessions", headers=published | foreign).status_code == 403


def test_each_client_is_counted_by_its_own_address(proxy: Nginx) -> None:
    """Whatever it says of itself."""
    wrong = {"Authorization": "Bearer sk_wrong"}
    with browser(proxy, "127.0.0.5", **wrong) as one, browser(proxy, "127.0.0.6", **wrong) as other:
        said = [{"X-Forwarded-For": f"10.0.0.{number}"} for number in range(4)]
        assert [one.post("api/v1/sessions", headers=headers).status_code for headers in said] == [401, 401, 401, 429]
        assert other.post("api/v1/sessions", headers={"X-Forwarded-For": "127.0.0.5"}).status_code == 401


def test_a_request_just_small_enough_comes_through(proxy: Nginx) -> None:
    """To be refused for what it is, by the server."""
    with browser(proxy) as somebody:
        answer = somebody.post(
            "api/v1/step", content=b" " * (8 * MEBIBYTE), headers={"Authorization": "Bearer ss_unknown"}
        )
    assert (answer.status_code, answer.json()["code"]) == (422, "invalid_request")


def test_a_request_too_large_is_refused_in_the_words_of_the_api(proxy: Nginx, key: str) -> None:
    with browser(proxy) as somebody:
        answer = somebody.post("api/v1/step", content=b" " * (8 * MEBIBYTE + 1))
    expected = describe(Large("")) | {"detail": answer.json()["detail"]}
    assert answer.status_code == 413
    assert answer.headers["Content-Type"] == "application/problem+json"
    assert expected.items() <= answer.json().items()
    with Client(key, proxy.url) as client:
        session = client.session()
        with pytest.raises(RequestTooLarge):
            session.step(HERE, info={"too much": "x" * 9 * MEBIBYTE})
        assert session.step(HERE).action in (0, 1)


def test_a_server_that_is_away_is_told_in_the_words_of_the_api(key: str) -> None:
    with running(Nginx(f"{ALL}:{free_port()}")) as proxy, browser(proxy) as somebody:
        for method, path in [("GET", "healthz"), ("POST", "api/v1/step"), ("DELETE", "api/v1/session")]:
            answer = somebody.request(method, path)
            expected = describe(Away("", retry_after=0.5)) | {"detail": answer.json()["detail"]}
            assert (answer.status_code, answer.headers["Retry-After"]) == (503, "1")
            assert answer.headers["Content-Type"] == "application/problem+json"
            assert expected.items() <= answer.json().items()
        assert somebody.post("shepherd/env/").json()["ok"] is False


def test_clients_wait_for_a_server_that_is_away(key: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with running(Nginx(f"{ALL}:{free_port()}")) as proxy:
        monkeypatch.setenv("SSL_CERT_FILE", str(proxy.certificate))
        with pytest.raises(Unavailable, match="No web process"):
            Client(key, proxy.url, patience=0).session()


def test_strangers_read_no_metrics(web: Server, proxy: Nginx) -> None:
    with browser(proxy) as stranger:
        assert {stranger.get(path).status_code for path in ("metrics", "%6detrics", "/metrics?x=1")} == {403}
    assert httpx.get(f"{web.url}metrics").status_code == 200


def test_pages_and_their_files_come_over_tls(proxy: Nginx, demo: dict[str, Any]) -> None:
    with browser(proxy) as visitor:
        for page in ("admin/login/", "bored/", "api/docs/"):
            answer = visitor.get(page)
            files = re.findall(r"""(?:src|href)="([^"#]+\.(?:js|css|svg|png))\b""", answer.text)
            assert answer.status_code == 200
            assert files
            assert {visitor.get(str(answer.url.join(file))).status_code for file in files} == {200}
            assert "http://" not in answer.headers.get("Content-Security-Policy", "")


@pytest.mark.browser
def test_a_visitor_of_bored_in_the_city_is_where_she_says_and_loves_a_place(visitor: Visitor) -> None:
    """Positions and service workers are for pages that came by TLS; the publishable key is for pages of this server."""
    visitor.opens().presses("Use my location")
    visitor.wait(lambda: visitor.memory()["locate"])
    first = visitor.asks_for_a_place()
    assert visitor.memory()["current"]["reason"]["located"]
    visitor.presses("I love it, add to favorites")
    assert visitor.asks_for_a_place() != first
    worker = "return navigator.serviceWorker.ready.then((ready) => ready.active.scriptURL)"
    assert visitor.browser.execute_script(worker).startswith(f"{visitor.url}bored/")
    complaints = [entry["message"] for entry in visitor.browser.get_log("browser") if entry["level"] == "SEVERE"]
    assert complaints == []
