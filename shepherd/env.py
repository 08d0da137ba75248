"""Reading settings from the environment, strictly: a value that does not parse stops the start with its name."""

import json
import os
import secrets
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import dj_database_url
from django.core.exceptions import ImproperlyConfigured

FOLDER = "envs_app.execution.storage.Folder"  # without Django, for embedded executions
TRUE, FALSE = {"1", "true", "yes", "on"}, {"0", "false", "no", "off", ""}


def text(name: str, default: str = "") -> str:
    """The variable as it stands."""
    return os.environ.get(name, default)


def confidential(name: str) -> str:
    """The variable, or what the file holds that NAME_FILE names; empty: neither. Raises ImproperlyConfigured."""
    if not (path := os.environ.get(f"{name}_FILE")):
        return os.environ.get(name, "")
    try:
        return Path(path).read_text().strip()
    except OSError as error:
        raise ImproperlyConfigured(f"{name}_FILE is {path}, which cannot be read ({error.strerror}).") from None


def boolean(name: str, default: bool) -> bool:
    """The variable as a truth value. Raises ImproperlyConfigured if it is none."""
    value = os.environ.get(name)
    if value is None:
        return default
    if value.lower() in TRUE | FALSE:
        return value.lower() in TRUE
    raise ImproperlyConfigured(f"{name} is {value!r}: write 1 or 0.")


def integer(name: str, default: int, minimum: int = 0) -> int:
    """The variable as a whole number. Raises ImproperlyConfigured if it is none or too small."""
    value = os.environ.get(name)
    if not value:
        return default
    try:
        number = int(value)
    except ValueError:
        raise ImproperlyConfigured(f"{name} is {value!r}: write a whole number.") from None
    if number < minimum:
        raise ImproperlyConfigured(f"{name} is {number}: write {minimum} or more.")
    return number


def cores() -> int:
    """The processors that this process may use."""
    return len(os.sched_getaffinity(0))


def words(name: str, default: str = "") -> list[str]:
    """The variable as a list, separated by commas."""
    return [word.strip() for word in os.environ.get(name, default).split(",") if word.strip()]


def choice(name: str, choices: list[str]) -> str:
    """The variable, one of `choices`; the first is the default. Raises ImproperlyConfigured if it is another."""
    value = os.environ.get(name) or choices[0]
    if value not in choices:
        raise ImproperlyConfigured(f"{name} is {value!r}: write one of {', '.join(choices)}.")
    return value


def database(name: str, default: str) -> dict[str, Any]:
    """The variable as Django's settings of a database. Raises ImproperlyConfigured if it is no address of one."""
    try:
        settings = dj_database_url.parse(confidential(name) or default, conn_max_age=600, conn_health_checks=True)
    except ValueError:
        raise ImproperlyConfigured(
            f"{name} cannot be read: write it like postgres://user:password@host/name."
        ) from None
    return dict(settings)


def postgres(connections: int) -> dict[str, Any]:
    """How a process is connected to PostgreSQL: by so many connections at most, for one of which a thread waits 5 s.

    libpq gives up on a server that is cut off; psycopg's pool begins anew with each wish for a connection, as its own pauses
    between attempts would grow to minutes.
    """
    pool = {"min_size": 0, "max_size": connections, "timeout": 5.0, "reconnect_timeout": 2.0}
    cut_off = {"connect_timeout": 5, "tcp_user_timeout": 15_000, "keepalives_idle": 10, "keepalives_interval": 5}
    return {"pool": pool, "keepalives_count": 2, **cut_off}


def redis(name: str) -> str:
    """The variable as the address of a Redis server; empty: there is none. Raises ImproperlyConfigured if it is no address."""
    value = confidential(name)
    if value and urlsplit(value).scheme not in ("redis", "rediss", "unix"):
        raise ImproperlyConfigured(f"{name} cannot be read: write it like redis://:password@host:6379/0.")
    return value


def cache(redis_url: str) -> dict[str, Any]:
    """Django's settings of a cache: all machines share the one in Redis; without Redis each process has its own."""
    if not redis_url:
        return {"BACKEND": "django.core.cache.backends.locmem.LocMemCache"}
    options = {"socket_timeout": 2.0, "socket_connect_timeout": 2.0}
    backend = "django.core.cache.backends.redis.RedisCache"
    return {"BACKEND": backend, "LOCATION": redis_url, "KEY_PREFIX": "shepherd:cache", "OPTIONS": options}


def options(name: str) -> dict[str, Any]:
    """The variable (or its file) as a JSON object; none: empty. Raises ImproperlyConfigured if it is no object."""
    try:
        value = json.loads(confidential(name) or "{}")
    except ValueError:
        value = None
    if not isinstance(value, dict):
        raise ImproperlyConfigured(f'{name} cannot be read: write it like {{"bucket_name": "saves"}}.')
    return value


def storage(name: str, options: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Django's settings of a storage: the class that the variable names; without it, a folder of this machine."""
    if backend := os.environ.get(name):
        return {"BACKEND": backend, "OPTIONS": options}
    return {"BACKEND": FOLDER, "OPTIONS": {"location": str(folder)} | options}


def secret(name: str, folder: Path) -> str:
    """The variable, or a secret made once and kept in a file that only this user can read."""
    if value := confidential(name):
        return value
    path = folder / name.lower()
    try:
        if not path.exists():
            _make_secret(path)
        return path.read_text()
    except OSError as error:
        raise ImproperlyConfigured(
            f"{path} cannot be written or read ({error.strerror}): "
            "set SHEPHERD_DATA to a folder of yours that has free space."
        ) from None


def _make_secret(path: Path) -> None:
    """Write a new secret, readable by this user only; of several processes that do so at once, the first wins."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f"{path.name}.{os.getpid()}")
    partial.touch(mode=0o600)
    try:
        partial.write_text(secrets.token_urlsafe(48))
        os.link(partial, path)
    except FileExistsError:
        pass
    finally:
        partial.unlink()
