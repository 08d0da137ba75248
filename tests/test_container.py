"""The image and the compose file agree with the settings and with what is there to copy."""

from __future__ import annotations

import re
from typing import Any

import yaml

from tests.servers import PROJECT
from tests.test_docs import settings_read

BUILD = (PROJECT / "Dockerfile").read_text()
COMPOSE: dict[str, Any] = yaml.safe_load((PROJECT / "docker-compose.yml").read_text())
SERVICE = COMPOSE["services"]["shepherd"]


def test_everything_that_is_copied_exists_and_is_not_ignored() -> None:
    sources = [word for line in re.findall(r"^COPY (.+) \S+$", BUILD, flags=re.MULTILINE) for word in line.split()]
    ignored = (PROJECT / ".dockerignore").read_text().splitlines()
    assert "agents_app" in sources
    assert [name for name in sources if not (PROJECT / name).exists() or f"!{name}" not in ignored] == []


def test_it_does_not_run_as_root_and_says_how_it_is() -> None:
    assert re.search(r"^USER shepherd$", BUILD, flags=re.MULTILINE)
    assert "/readyz" in BUILD.split("HEALTHCHECK")[1]


def test_only_settings_that_exist_are_set() -> None:
    set_there = {*SERVICE["environment"], *re.findall(r"\b(SHEPHERD_[A-Z_]+)=", BUILD)}
    assert set_there - settings_read() == set()


def test_what_must_last_is_in_a_volume() -> None:
    assert "SHEPHERD_DATA=/data" in BUILD
    assert SERVICE["volumes"] == ["data:/data"]
    assert "data" in COMPOSE["volumes"]


def test_it_has_time_to_save() -> None:
    from envs_app.serving.supervisor import EXECUTIONS_GRACE

    assert int(SERVICE["stop_grace_period"].removesuffix("s")) >= 20 + EXECUTIONS_GRACE
