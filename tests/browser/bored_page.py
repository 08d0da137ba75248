"""Bored in the city as its visitors meet it: what they see, and what they press."""

from __future__ import annotations

import base64
from collections.abc import Callable
from pathlib import Path
from typing import Any

from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

PHONE = (390, 844)  # CSS pixels
DESK = (1280, 800)
PATIENCE = 30  # seconds
HERE = {"latitude": 50.8503, "longitude": 4.3517, "accuracy": 10}


class Visitor:
    """Somebody with a browser."""

    def __init__(self, browser: webdriver.Chrome, url: str) -> None:
        self.browser, self.url = browser, url

    def command(self, name: str, **parameters: Any) -> Any:
        """A command of the DevTools."""
        return self.browser.execute_cdp_cmd(name, parameters)

    def is_new(self) -> Visitor:
        """The browser forgets this page, and whatever was switched on or off for the visitor before."""
        self.browser.get("about:blank")
        self.goes_offline(False)
        self.command("Storage.clearDataForOrigin", origin=self.url.rstrip("/"), storageTypes="all")
        return self

    def holds(self, size: tuple[int, int] = PHONE, dark: bool = False, languages: str = "en-GB") -> Visitor:
        """A device of this size, theme and language."""
        width, height = size
        mobile = size == PHONE
        self.command(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=2 if mobile else 1,
            mobile=mobile,
        )
        theme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        still = {"name": "prefers-reduced-motion", "value": "reduce"}
        self.command("Emulation.setEmulatedMedia", features=[theme, still])
        agent = self.browser.execute_script("return navigator.userAgent")
        self.command("Network.setUserAgentOverride", userAgent=agent, acceptLanguage=languages)
        return self

    def is_at(self, place: dict[str, float] | None) -> Visitor:
        """Lets the page know where they are; None: they refuse."""
        state = "granted" if place else "denied"
        self.command("Browser.setPermission", permission={"name": "geolocation"}, setting=state)
        if place:
            self.command("Emulation.setGeolocationOverride", **place)
        return self

    def opens(self, hash: str = "") -> Visitor:
        """The page, anew."""
        self.browser.get("about:blank")
        self.browser.get(f"{self.url}bored/{hash}")
        self.sees("#panel h2")
        return self

    def wait(self, condition: Callable[[], Any]) -> Any:
        """The first true value of the condition."""
        return WebDriverWait(self.browser, PATIENCE, ignored_exceptions=[Exception]).until(lambda _: condition())

    def sees(self, css: str, text: str = "") -> str:
        """The text of the first such element, once it contains this."""

        def found() -> Any:
            element = self.browser.find_element(By.CSS_SELECTOR, css)
            return element if element.is_displayed() and text in element.text else None

        return self.wait(found).text

    def has(self, css: str) -> bool:
        """Whether there is such an element now."""
        return bool(self.browser.find_elements(By.CSS_SELECTOR, css))

    def presses(self, name: str, within: str = "body") -> Visitor:
        """The button or link of this name."""
        script = r"""
            const [within, name] = arguments;
            const all = [...document.querySelector(within).querySelectorAll("button, a, summary")];
            const names = (one) => {
              const text = one.innerText.trim();
              return [text.replace(/\s+/g, " "), text.split("\n")[0], one.getAttribute("aria-label")];
            };
            return all.find((one) => names(one).includes(name)) ?? null;
        """
        self.wait(lambda: self.browser.execute_script(script, within, name)).click()
        return self

    def place(self) -> str:
        """The name of the suggested place, once there is one to decide about."""
        self.sees("#panel .dismiss")
        return self.sees("#panel h2")

    def asks_for_a_place(self) -> str:
        """From the welcome, or after a place was loved."""
        self.presses("Next place")
        return self.place()

    def memory(self) -> dict[str, Any]:
        """What the page remembers of them."""
        return self.browser.execute_script("return JSON.parse(localStorage['bored-in-the-city'] ?? '{}')")

    def goes_offline(self, offline: bool = True) -> Visitor:
        """Without any network, or with it again."""
        self.command("Network.enable")
        self.command(
            "Network.emulateNetworkConditions", offline=offline, latency=0, downloadThroughput=-1, uploadThroughput=-1
        )
        return self

    def photographs(self, file: Path) -> None:
        """What is on the screen."""
        file.write_bytes(base64.b64decode(self.command("Page.captureScreenshot", format="png")["data"]))
