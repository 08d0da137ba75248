"""The commands of a newcomer: what `make` and `.ci/run` promise before anything is installed."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.servers import PROJECT

REQUIREMENTS = (
    "requirements.txt",
    "requirements-dev.txt",
    "clients/python/pyproject.toml",
    "clients/environments/pyproject.toml",
)


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """What make looks at, as in a fresh clone."""
    for name in ("Makefile", *REQUIREMENTS):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(PROJECT / name, tmp_path / name)
    return tmp_path


@pytest.fixture
def installed(clone: Path) -> Path:
    """The same after an installation."""
    (clone / ".venv" / "bin").mkdir(parents=True)
    for name in ("bin/python", ".runtime", ".dev"):
        (clone / ".venv" / name).touch()
    return clone


def make(folder: Path, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run make there."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    command = ["make", "--no-print-directory", *arguments]
    return subprocess.run(command, cwd=folder, env=kept | environment, capture_output=True, text=True)


def python_of(folder: Path, version: str, modern: bool) -> str:
    """A program that answers as Python of that version does."""
    path = folder / f"python{version}"
    path.write_text(f'#!/bin/sh\n[ "$1" = -V ] && echo "Python {version}" && exit 0\nexit {0 if modern else 1}\n')
    path.chmod(0o755)
    return str(path)


def test_help_lists_every_command(clone: Path) -> None:
    targets = set(re.findall(r"^([a-z]+):", (clone / "Makefile").read_text(), flags=re.MULTILINE))
    assert {"setup", "run", "demo", "test", "bench", "lint"} <= targets
    assert {line.split()[1] for line in make(clone).stdout.splitlines()} == targets


def test_a_python_that_is_too_old_is_named(clone: Path) -> None:
    done = make(clone, "run", f"PYTHON={python_of(clone, '3.9.18', modern=False)}")
    assert "Shepherd needs Python 3.11 or newer; " in done.stdout
    assert "is Python 3.9.18" in done.stdout
    assert done.returncode != 0
    assert not (clone / ".venv").exists()


def test_a_python_that_is_not_there_is_named(clone: Path) -> None:
    done = make(clone, "run", "PYTHON=/nowhere/python3")
    assert "There is no /nowhere/python3" in done.stdout
    assert done.returncode != 0


def test_no_python_at_all_is_said(clone: Path) -> None:
    done = make(clone, "run", "PYTHON=")
    assert "Shepherd needs Python 3.11 or newer, and none was found" in done.stdout
    assert done.returncode != 0


@pytest.mark.parametrize("target", ["run", "demo"])
def test_serving_installs_nothing_that_only_tests_need(clone: Path, target: str) -> None:
    plan = make(clone, "--dry-run", target, f"PYTHON={sys.executable}").stdout
    assert "-r requirements.txt" in plan
    assert "requirements-dev.txt" not in plan


@pytest.mark.parametrize("target", ["run", "demo", "test", "lint", "bench"])
def test_a_second_call_installs_nothing(installed: Path, target: str) -> None:
    assert "pip" not in make(installed, "--dry-run", target).stdout


@pytest.mark.parametrize("name", REQUIREMENTS)
def test_changed_requirements_are_installed(installed: Path, name: str) -> None:
    later = (installed / ".venv" / ".dev").stat().st_mtime + 10
    os.utime(installed / name, (later, later))
    assert "pip install" in make(installed, "--dry-run", "test").stdout


def test_the_port_and_the_data_folder_reach_the_server(installed: Path) -> None:
    """As variables of make or of the environment."""
    (installed / ".venv" / "bin" / "python").write_text('#!/bin/sh\necho "$PORT $SHEPHERD_DATA"\n')
    (installed / ".venv" / "bin" / "python").chmod(0o755)
    for target in ("run", "demo"):
        assert make(installed, target, "PORT=8123", "SHEPHERD_DATA=/some/where").stdout == "8123 /some/where\n"
        assert make(installed, target, PORT="8123", SHEPHERD_DATA="/some/where").stdout == "8123 /some/where\n"


def test_ci_is_a_script_that_can_be_run() -> None:
    script = PROJECT / ".ci" / "run"
    assert os.access(script, os.X_OK)
    assert subprocess.run(["bash", "-n", script], capture_output=True).returncode == 0
    assert {"make lint", "make test"} <= set(script.read_text().splitlines())


@pytest.mark.parametrize(("environment", "outcome"), [({}, "1 skipped"), ({"CI": "true"}, "1 failed")])
def test_ci_skips_no_test_for_a_missing_browser(tmp_path: Path, environment: dict[str, str], outcome: str) -> None:
    test = tmp_path / "test_it.py"
    test.write_text('import pytest\n\n@pytest.mark.browser\ndef test_it():\n    pytest.skip("no browser")\n')
    kept = {name: value for name, value in os.environ.items() if name != "CI" and not name.startswith("PYTEST")}
    command = [sys.executable, "-m", "pytest", "-p", "tests.conftest", "-c", str(PROJECT / "pyproject.toml"), str(test)]
    done = subprocess.run(command, cwd=PROJECT, env=kept | environment, capture_output=True, text=True)
    assert outcome in done.stdout.splitlines()[-1]
