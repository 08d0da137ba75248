"""The people and agents of the administration's tests."""

from tests.admin.conftest import agent, ann, boss, client, fleet, foreign

__all__ = ["agent", "ann", "boss", "client", "fleet", "foreign"]
