"""Wrong settings speak: as a system check with an id and a hint, or before anything starts."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from shepherd import checks
from shepherd.env import storage
from tests.servers import PROJECT


def ids(messages: list[Any]) -> list[str]:
    """The ids of check messages, all of which must have a hint."""
    assert all(message.hint for message in messages)
    return [message.id for message in messages]


def manage(tmp_path: Path, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run manage.py in a new data folder."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("SHEPHERD_")}
    return subprocess.run(
        [sys.executable, "manage.py", *arguments],
        cwd=PROJECT,
        env=kept | {"SHEPHERD_DATA": str(tmp_path)} | environment,
        capture_output=True,
        text=True,
    )


def test_a_session_may_not_lose_its_execution_during_a_step(settings: Any) -> None:
    settings.RECLAIM_SECONDS = settings.STEP_TIMEOUT
    assert ids(checks.check_times()) == ["shepherd.E001"]


def test_executions_idle_before_they_can_be_reclaimed_are_a_warning(settings: Any) -> None:
    settings.IDLE_SECONDS = settings.RECLAIM_SECONDS - 1
    assert ids(checks.check_times()) == ["shepherd.W001"]


@pytest.mark.parametrize(
    "saves",
    [
        {"BACKEND": "tests.storages.Pathless", "OPTIONS": {"location": "/nowhere"}},
        storage("", {"location": "/mnt"}, Path()),
    ],
)
def test_embedded_executions_save_in_the_data_folder(settings: Any, saves: dict[str, Any]) -> None:
    assert checks.check_saves() == []
    settings.STORAGES = settings.STORAGES | {"saves": saves}
    assert ids(checks.check_saves()) == ["shepherd.E003"]
    settings.TRANSPORT = "redis"
    assert checks.check_saves() == []


@pytest.mark.parametrize(
    ("backend", "options"), [("storages.Missing", {}), ("tests.storages.Pathless", {"bucket": "a"})]
)
def test_a_storage_of_saves_that_cannot_be_made_is_said(settings: Any, backend: str, options: dict[str, Any]) -> None:
    settings.TRANSPORT = "redis"
    settings.STORAGES = settings.STORAGES | {"saves": {"BACKEND": backend, "OPTIONS": options}}
    assert ids(checks.check_saves()) == ["shepherd.E004"]


def test_secrets_that_others_can_read_are_a_warning(settings: Any) -> None:
    secret = settings.DATA_DIR / "secrets" / "shepherd_secret_key"
    secret.parent.mkdir(parents=True)
    secret.touch(mode=0o600)
    assert checks.check_secrets() == []
    secret.chmod(0o644)
    assert ids(checks.check_secrets()) == ["shepherd.W002"]


def test_the_deployment_check_is_clean_behind_tls(tmp_path: Path) -> None:
    done = manage(
        tmp_path, "check", "--deploy", "--fail-level", "WARNING", SHEPHERD_TLS="1", SHEPHERD_ALLOWED_HOSTS="example.org"
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "no issues" in done.stdout


@pytest.mark.parametrize(
    ("environment", "said"),
    [
        (
            {"DATABASE_URL": "nonsense"},
            "DATABASE_URL cannot be read: write it like postgres://user:password@host/name.",
        ),
        (
            {"SHEPHERD_SAVES_OPTIONS": "shepherd"},
            'SHEPHERD_SAVES_OPTIONS cannot be read: write it like {"bucket_name": "saves"}.',
        ),
        ({"SHEPHERD_TLS": "perhaps"}, "SHEPHERD_TLS is 'perhaps': write 1 or 0."),
        ({"SHEPHERD_DATA": "/proc/shepherd"}, "set SHEPHERD_DATA to a folder of yours that has free space."),
    ],
)
def test_a_setting_that_cannot_be_read_is_one_line(tmp_path: Path, environment: dict[str, str], said: str) -> None:
    done = manage(tmp_path, "check", **environment)
    assert done.returncode == 1
    assert done.stderr.startswith("Wrong setting: ")
    assert done.stderr.endswith(f"{said}\n")
    assert done.stderr.count("\n") == 1


def test_secrets_are_made_once_and_for_this_user_only(tmp_path: Path) -> None:
    path = tmp_path / "secrets" / "shepherd_secret_key"
    assert manage(tmp_path, "check").returncode == 0
    made = path.read_text()
    assert manage(tmp_path, "check").returncode == 0
    assert (path.read_text(), path.stat().st_mode & 0o777) == (made, 0o600)
    assert len(made) >= 50


def test_options_in_the_address_of_the_database_hold(tmp_path: Path) -> None:
    show = "from django.conf import settings; print(settings.DATABASES['default']['OPTIONS'])"
    url = "postgres://me@db/shepherd?sslmode=require&connect_timeout=9"
    done = manage(tmp_path, "shell", "-v", "0", "-c", show, DATABASE_URL=url, SHEPHERD_DATABASE_POOL="3")
    options = ast.literal_eval(done.stdout.splitlines()[-1])
    assert (options["sslmode"], options["connect_timeout"], options["pool"]["max_size"]) == ("require", 9, 3)
