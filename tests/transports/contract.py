"""What every transport must do. A subclass gives the fixture `engine`: the executions' side, running, for tests to break."""

from __future__ import annotations

from tests.transports.clauses.admin import Admin
from tests.transports.clauses.events import Events
from tests.transports.clauses.failures import Failures
from tests.transports.clauses.finding import Finding
from tests.transports.clauses.learning import Learning
from tests.transports.clauses.steps import Steps


class TransportContract(Learning, Events, Admin, Failures, Steps, Finding):
    """The tests. They share the engine, and each has agents of its own."""
