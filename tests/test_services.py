"""The services that tests of other files need do what they promise."""

from __future__ import annotations

import subprocess

import psycopg
import pytest

from tests.services import PostgresServer, RedisServer, fresh_database, shared_postgres


def tables(url: str) -> list[tuple[str]]:
    """The names of the tables in a database."""
    with psycopg.connect(url, connect_timeout=10) as connection:
        return connection.execute("SELECT tablename FROM pg_tables WHERE schemaname = 'public'").fetchall()


def test_a_database_is_empty_and_goes_with_its_connections(postgres_url):
    assert tables(postgres_url) == []
    with fresh_database() as other:
        connection = psycopg.connect(other, connect_timeout=10)
        connection.execute("CREATE TABLE mine (id int)")
        connection.commit()
        assert tables(other) == [("mine",)]
    with pytest.raises(psycopg.OperationalError):
        connection.execute("SELECT 1")
    assert tables(postgres_url) == []
    assert postgres_url.startswith(shared_postgres())


def test_postgresql_keeps_its_rows_through_a_kill(postgres_server: PostgresServer):
    with psycopg.connect(postgres_server.url, connect_timeout=10) as connection:
        connection.execute("CREATE TABLE mine (id int)")
    postgres_server.kill()
    assert not postgres_server.answers()
    postgres_server.start()
    assert tables(postgres_server.url) == [("mine",)]


def test_redis_answers_nothing_in_a_pause_and_forgets_in_a_restart(redis_server: RedisServer):
    redis_server.command("set", "key", "value")
    redis_server.pause()
    with pytest.raises(subprocess.TimeoutExpired):
        redis_server.command("get", "key", seconds=1)
    redis_server.resume()
    assert redis_server.command("get", "key") == "value"
    redis_server.restart()
    assert redis_server.command("get", "key") == ""


def test_redis_reports_what_it_refuses(redis_server: RedisServer):
    redis_server.command("config", "set", "maxmemory", "1")
    with pytest.raises(RuntimeError, match="OOM"):
        redis_server.command("set", "key", "value")


def test_who_takes_a_service_is_marked(request: pytest.FixtureRequest, redis_server: RedisServer):
    assert request.node.get_closest_marker("service")
