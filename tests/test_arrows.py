"""The arrows of DESIGN.md section 2, read from the imports of every module.

views -> sessions -> transports -> execution -> ShepherdEnv, algorithms -> spaces, messages, errors
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.servers import PROJECT

ROOMS = ("agents_app", "envs_app", "shepherd", "clients", "frontend")
DJANGO = ("django", "rest_framework", "corsheaders", "drf_spectacular", "unfold")
PICKLES = ("pickle", "cloudpickle", "dill", "joblib", "shelve", "marshal")
HEAVY = ("torch", "stable_baselines3", "sb3_contrib")

PAGES = ("frontend/**/*.html", "frontend/**/*.js", "*_app/templates/**/*.html", "*_app/static/**/*.js")

# Who: modules whose path matches. Never: what they do not import, not even within a function.
ARROWS: list[tuple[str, str, tuple[str, ...]]] = [
    ("algorithms are pure RL", "agents_app/algorithms/**/*.py", (*DJANGO, "agents_app.models", "envs_app", "shepherd")),
    ("spaces have no Django", "agents_app/spaces.py", (*DJANGO, *HEAVY, "envs_app", "shepherd")),
    ("demos have no Django", "agents_app/demos.py", (*DJANGO, *HEAVY, "agents_app.models", "envs_app", "shepherd")),
    ("executions have no Django", "envs_app/execution/**/*.py", (*DJANGO, "agents_app.models", "shepherd")),
    ("executions know no caller", "envs_app/execution/**/*.py", ("envs_app.views", "envs_app.sessions")),
    ("ShepherdEnv has no Django", "envs_app/shepherd_env.py", (*DJANGO, "agents_app.models", "shepherd")),
    ("errors know nothing", "envs_app/errors.py", (*DJANGO, *HEAVY, "agents_app", "envs_app", "shepherd")),
    ("steps know nothing", "envs_app/steps.py", (*DJANGO, *HEAVY, "agents_app", "shepherd")),
    ("messages have no Django", "envs_app/messages.py", (*DJANGO, *HEAVY, "agents_app.models", "shepherd")),
    ("observations have no Django", "envs_app/observations.py", (*DJANGO, *HEAVY, "agents_app.models", "shepherd")),
    # All but client.py; child.py has a row of its own.
    ("the parent has no Django", "envs_app/transports/local/[!c]*.py", (*DJANGO, "agents_app.models", "shepherd")),
    ("loops have no Django", "envs_app/transports/loop.py", (*DJANGO, "agents_app.models", "shepherd")),
    (
        "populations have no Django",
        "envs_app/transports/population.py",
        (*DJANGO, *HEAVY, "agents_app.models", "shepherd"),
    ),
    (
        "executions over Redis have no Django",
        "envs_app/transports/redis/child.py",
        (*DJANGO, "agents_app.models", "shepherd"),
    ),
    ("the Redis client has no torch", "envs_app/transports/redis/client.py", HEAVY),
    ("its children have no Django", "envs_app/transports/local/child.py", (*DJANGO, "agents_app.models", "shepherd")),
    ("agents do not know environments", "agents_app/**/*.py", ("envs_app",)),
    ("views go through sessions", "envs_app/views/**/*.py", ("envs_app.transports", "envs_app.execution")),
    ("the web has no torch", "envs_app/views/**/*.py", HEAVY),
    ("models have no torch", "agents_app/models/**/*.py", HEAVY),
    ("transports know no view", "envs_app/transports/**/*.py", ("envs_app.views", "envs_app.sessions")),
    ("clients know only HTTP", "clients/**/*.py", ("agents_app", "envs_app", "shepherd", "django")),
    ("pages know agents alone", "frontend/**/*.py", ("envs_app", *HEAVY)),
    ("nothing unpickles: agents", "agents_app/**/*.py", PICKLES),
    ("nothing unpickles: environments", "envs_app/**/*.py", PICKLES),
    ("nothing unpickles: the project", "shepherd/**/*.py", PICKLES),
    ("no torch in the Django project", "shepherd/**/*.py", HEAVY),
]


def imports_of(path: Path) -> Iterator[str]:
    """The dotted names that a module imports: `from a import b` gives a and a.b."""
    package = ".".join(path.relative_to(PROJECT).with_suffix("").parts)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = node.module or ""
            if node.level:
                module = ".".join([*package.split(".")[: -node.level], *module.split(".")]).rstrip(".")
            yield module
            yield from (f"{module}.{alias.name}" for alias in node.names)


def is_within(name: str, packages: tuple[str, ...]) -> bool:
    """Whether a dotted name is one of these packages, or in one."""
    return any(name == package or name.startswith(f"{package}.") for package in packages)


def modules(pattern: str) -> list[Path]:
    """The files of a pattern, without what is installed for JavaScript."""
    return [path for path in sorted(PROJECT.glob(pattern)) if "node_modules" not in path.parts]


@pytest.mark.parametrize(("rule", "who", "never"), ARROWS, ids=[f"{rule}: {who}" for rule, who, _ in ARROWS])
def test_imports_follow_the_arrows(rule: str, who: str, never: tuple[str, ...]) -> None:
    found = [(path, name) for path in modules(who) for name in imports_of(path)]
    wrong = [f"{path.relative_to(PROJECT)} imports {name}" for path, name in found if is_within(name, never)]
    assert not wrong, f"{rule}: {wrong}"


def test_every_rule_is_about_something() -> None:
    assert [who for _, who, _ in ARROWS if not modules(who)] == []


def test_the_rules_see_every_form_of_import(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "PROJECT", tmp_path)
    module = tmp_path / "room" / "sub" / "module.py"
    module.parent.mkdir(parents=True)
    module.write_text(
        "import a.b\nfrom c import d\nfrom . import e\nfrom ..f import g\n\ndef h():\n    from i import j\n"
    )
    assert {"a.b", "c.d", "room.sub.e", "room.f.g", "i.j"} <= set(imports_of(module))


def test_the_front_end_asks_only_this_server() -> None:
    """Pages load nothing from another host, so that they work without the internet."""
    pages = [path for pattern in PAGES for path in modules(pattern)]
    foreign = ('src="http', "src='http", 'src="//', 'from "http', "import('http", 'import("http', '@import url("http')
    wrong = [str(path.relative_to(PROJECT)) for path in pages if any(text in path.read_text() for text in foreign)]
    assert wrong == []


RESOLVE = """
import sys
from shepherd.wsgi import application
from django.urls import get_resolver

def walk(patterns):
    for pattern in patterns:
        if hasattr(pattern, "url_patterns"):
            walk(pattern.url_patterns)
        else:
            pattern.callback

walk(get_resolver().url_patterns)
loaded = sorted(name for name in sys.modules if name.split(".")[0] in {heavy})
assert not loaded, loaded
"""


def test_the_web_process_loads_no_torch(tmp_path: Path) -> None:
    """Whatever any page or endpoint imports."""
    done = subprocess.run(
        [sys.executable, "-c", RESOLVE.replace("{heavy}", repr(set(HEAVY)))],
        cwd=PROJECT,
        env={"SHEPHERD_DATA": str(tmp_path), "PATH": ""},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr


PARENT = "import envs_app.transports.local.parent, sys; assert 'django' not in sys.modules"


def test_the_parent_of_the_executions_loads_no_django() -> None:
    done = subprocess.run([sys.executable, "-c", PARENT], cwd=PROJECT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
