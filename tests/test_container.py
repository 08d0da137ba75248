"""The image and the compose files agree with the settings, with each other, and with what is there to copy."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any

import pytest
import yaml

from tests.servers import PROJECT
from tests.test_docs import settings_read

BUILD = (PROJECT / "Dockerfile").read_text()
COMPOSE: dict[str, Any] = yaml.safe_load((PROJECT / "docker-compose.embedded.yml").read_text())
SCALED: dict[str, Any] = yaml.safe_load((PROJECT / "docker-compose.yml").read_text())
OURS = ("migrate", "web", "worker", "beat")
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


@pytest.mark.parametrize("name", OURS)
def test_the_parts_of_a_scaled_out_shepherd_have_settings_that_exist(name: str) -> None:
    names = {variable.removesuffix("_FILE") for variable in SCALED["services"][name]["environment"]}
    assert names - settings_read() == set()
    assert {"DATABASE_URL", "REDIS_URL", "SHEPHERD_SECRET_KEY"} <= names


@pytest.mark.parametrize("name", SCALED["services"])
def test_every_part_begins_again_by_itself_and_is_not_root(name: str) -> None:
    service = SCALED["services"][name]
    assert service["restart"] == ("no" if name == "migrate" else "unless-stopped")
    assert "build" in service or "user" in service or "unprivileged" in service["image"]


def test_only_the_proxy_is_reached_from_outside() -> None:
    assert [name for name, service in SCALED["services"].items() if "ports" in service] == ["proxy"]


def test_nothing_refers_to_what_is_not_there() -> None:
    for name, service in SCALED["services"].items():
        assert set(service.get("secrets", ())) <= set(SCALED["secrets"]), name
        assert set(service.get("depends_on", ())) <= set(SCALED["services"]), name
        volumes = {volume.split(":")[0] for volume in service.get("volumes", ())}
        assert volumes <= set(SCALED["volumes"]), name
        assert {config["source"] for config in service.get("configs", ())} <= set(SCALED["configs"]), name
    assert (PROJECT / SCALED["configs"]["nginx"]["file"]).exists()


def test_who_is_waited_for_says_when_it_is_healthy() -> None:
    for service in SCALED["services"].values():
        for name, wanted in service.get("depends_on", {}).items():
            if wanted["condition"] == "service_healthy" and name != "web":  # the image says how the web is
                assert SCALED["services"][name]["healthcheck"]["test"]


@pytest.mark.parametrize("name", ["worker", "beat"])
def test_workers_are_started_with_options_that_celery_has_and_queues_that_exist(name: str) -> None:
    from celery.bin.worker import worker

    from shepherd.celery import app

    words = SCALED["services"][name]["command"]
    assert words[:4] == ["celery", "-A", "shepherd", "worker"]
    chosen = worker.make_context("worker", words[4:], obj=SimpleNamespace(app=app), resilient_parsing=True).params
    assert set(chosen["queues"]) <= set(app.conf.task_queues and [queue.name for queue in app.conf.task_queues])


def test_the_parts_have_time_to_save() -> None:
    for name in OURS:
        assert SCALED["services"][name]["stop_grace_period"] == SERVICE["stop_grace_period"]
