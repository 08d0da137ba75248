"""A real browser that talks to nobody but the server under test."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlparse

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service

FLAGS = (
    "--headless=new --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --disable-dev-shm-usage --window-size=1500,1100"
)


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[webdriver.Chrome]:
    """Chromium without a past."""
    with running_browser(tmp_path / "profile") as chrome:
        yield chrome


@contextmanager
def running_browser(profile: Path, *flags: str) -> Iterator[webdriver.Chrome]:
    """Chromium, which keeps what it remembers in `profile`, and a log of its console and of all requests."""
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not chromium or not driver:
        pytest.skip("needs chromium and chromedriver")
    options = Options()
    options.binary_location = chromium
    for flag in [*FLAGS.split(), *flags, f"--user-data-dir={profile}"]:
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    chrome = webdriver.Chrome(options, Service(driver))
    try:
        yield chrome
    finally:
        chrome.quit()


@pytest.fixture
def complaints(browser: webdriver.Chrome) -> Callable[[], list[str]]:
    """What the console says of errors and warnings since the last time."""
    return lambda: [e["message"] for e in browser.get_log("browser") if e["level"] in ("SEVERE", "WARNING")]


@pytest.fixture
def hosts(browser: webdriver.Chrome) -> Callable[[], set[str]]:
    """The hosts that were asked for anything since the last time."""

    def asked() -> set[str]:
        events: list[Any] = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
        urls = [e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"]
        return {urlparse(url).netloc for url in urls if url.startswith(("http", "ws"))}

    return asked
