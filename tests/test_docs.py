"""The documentation says all that there is: every setting, endpoint, error code, command and make target."""

from __future__ import annotations

import re
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest

from envs_app.errors import BY_CODE
from tests.servers import PROJECT

READ = re.compile(r"""(?:env\.\w+|environ(?:\.get)?|getenv)[(\[]\s*["']([A-Z][A-Z_]+)["']""")
NOT_OURS = {"CI", "DJANGO_SETTINGS_MODULE", "PROMETHEUS_MULTIPROC_DIR"}
REQUIREMENTS = ("requirements.txt", "requirements-s3.txt", "requirements-dev.txt")
SERVE = "envs_app/management/commands/serve.py"
LINK = re.compile(r"\]\(([^)#\s]+)(?:#[\w-]*)?\)")


def text_of(name: str) -> str:
    """A page of the documentation."""
    return (PROJECT / name).read_text(encoding="utf-8")


def settings_read() -> set[str]:
    """The environment variables that the server's code reads."""
    files = [
        path for room in ("shepherd", "agents_app", "envs_app", "frontend") for path in (PROJECT / room).rglob("*.py")
    ]
    return {name for path in files for name in READ.findall(path.read_text(encoding="utf-8"))} - NOT_OURS


def endpoints() -> list[str]:
    """The addresses of the API, as they are written."""
    from envs_app.urls import urlpatterns

    return ["/" + re.sub(r"[\^$?]", "", str(pattern.pattern)) for pattern in urlpatterns]


def test_settings_are_found_where_they_are_read() -> None:
    assert {"PORT", "HOST", "SHEPHERD_DATA", "DATABASE_URL", "SHEPHERD_MAX_EXECUTIONS"} <= settings_read()


@pytest.mark.parametrize("name", sorted(settings_read()))
def test_every_setting_is_documented(name: str) -> None:
    assert f"| `{name}` |" in text_of("docs/operations.md")


def test_every_documented_setting_exists() -> None:
    documented = set(re.findall(r"^\| `([A-Z][A-Z_]+)` \|", text_of("docs/operations.md"), flags=re.MULTILINE))
    assert documented == settings_read()


def test_documented_defaults_are_the_real_ones() -> None:
    rows = dict(re.findall(r"^\| `([A-Z_]+)` \| (\d+) \|", text_of("docs/operations.md"), flags=re.MULTILINE))
    source = "".join(path.read_text() for path in [*(PROJECT / "shepherd").glob("*.py"), PROJECT / SERVE])
    real = re.findall(r"""env\.(?:integer|boolean)\(["'](\w+)["'], (\d[\d_ *]*|True|False)[,)]""", source)
    assert rows == {name: str(int(eval(value))) for name, value in real}


@pytest.mark.parametrize("path", endpoints())
def test_every_endpoint_is_documented(path: str) -> None:
    assert path in text_of("docs/api.md")


@pytest.mark.parametrize("code", sorted(BY_CODE))
def test_every_error_code_is_documented_with_its_status(code: str) -> None:
    assert re.search(rf"^\|[^\n]*`{code}`[^\n]*\b{BY_CODE[code].status}\b", text_of("docs/api.md"), flags=re.MULTILINE)


def test_every_command_is_documented() -> None:
    commands = [path.stem for path in PROJECT.glob("*_app/management/commands/*.py") if path.stem != "__init__"]
    documentation = "".join(page.read_text() for page in [PROJECT / "README.md", *(PROJECT / "docs").glob("*.md")])
    assert [name for name in commands if not re.search(rf"manage\.py {name}\b|make {name}\b", documentation)] == []


def pages() -> list[Path]:
    """Every page that is written for people and committed."""
    listed = subprocess.run(["git", "ls-files", "*.md"], cwd=PROJECT, capture_output=True, text=True).stdout.split()
    return [PROJECT / name for name in listed] or sorted(PROJECT.glob("docs/**/*.md"))


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(PROJECT)))
def test_no_link_leads_nowhere(page: Path) -> None:
    links = [link for link in LINK.findall(page.read_text(encoding="utf-8")) if "://" not in link]
    assert [link for link in links if not (page.parent / link).exists()] == []


def test_the_readme_has_every_dependency_and_why() -> None:
    wanted = re.findall(r"^([\w-]+)", text_of("requirements.txt") + text_of("requirements-s3.txt"), flags=re.MULTILINE)
    wanted = [name for name in wanted if name[0] != "-"]
    reasons = (
        text_of("README.md")
        .split("## Why each dependency")[1]
        .lower()
        .replace("its sidecar", "drf-spectacular-sidecar")
    )
    assert [name for name in wanted if name.lower() not in reasons] == []


def test_every_requirement_is_pinned() -> None:
    lines = [line for name in REQUIREMENTS for line in text_of(name).splitlines()]
    assert [line for line in lines if line and line[0] not in "#-" and "==" not in line] == []


def test_the_readme_shows_working_code_early() -> None:
    lines = text_of("README.md").splitlines()
    first = {
        language: next(n for n, line in enumerate(lines) if line == f"```{language}")
        for language in ("python", "js", "sh")
    }
    assert max(first.values()) <= 60


def test_the_changelog_knows_the_version() -> None:
    project: dict[str, Any] = tomllib.loads(text_of("pyproject.toml"))["project"]
    assert re.search(rf"^## (Unreleased|{re.escape(project['version'])})", text_of("CHANGELOG.md"), flags=re.MULTILINE)
