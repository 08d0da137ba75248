"""What carries steps from the web processes to the executions, wherever those run: one narrow interface.

An implementation is one package, one row of TRANSPORTS and a subclass of the contract tests (tests/transports/contract.py).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from envs_app.messages import Message


@dataclass(frozen=True)
class Address:
    """Where an execution is reached."""

    uid: str
    where: str


@dataclass(frozen=True)
class Claim:
    """A session that looks for an execution."""

    agent: str
    run: int
    session: int
    max_executions: int
    sessions_per_execution: int
    waits: bool = True  # False: it only wants one to be ready, and takes no place in the queue


class Away(ConnectionError):
    """What carries the steps is away, or has just come back: nobody knows of the execution. The step may be repeated there."""


class Transport(ABC):
    """The web process's side. Every method may raise ConnectionError when the executions' side is not there."""

    @abstractmethod
    def acquire(self, claim: Claim, exclude: Iterable[str] = ()) -> Address | None:
        """The execution that shall serve the session: the one it had, or a free one; None: launch one.

        Raises NoCapacity when none is free and no more may be started. `exclude`: uids that just refused.
        """

    @abstractmethod
    def launch(self, claim: Claim, spec: dict[str, Any], max_percent_cpu: int, exclude: Iterable[str] = ()) -> Address:
        """Start an execution for the session (execution.worker.ExecutionSpec as a dictionary). Raises NoCapacity."""

    @abstractmethod
    def call(self, address: Address, message: Message, timeout: float) -> Message:
        """Send one step and wait for its answer. Raises ConnectionError when the execution is gone, Away, TimeoutError."""

    @abstractmethod
    def forget(self, session: int, agent: str) -> None:
        """The session is closed: free its place, and delete its ledger."""

    @abstractmethod
    def status(self, agent: str | None = None) -> list[dict[str, Any]]:
        """The live executions (agents_app.fleet.ExecutionStatus), of one agent or of all."""

    @abstractmethod
    def configure(self, agent: str, settings: dict[str, Any]) -> None:
        """Tell the agent's live executions: learning, max_percent_cpu, sessions, save_interval."""

    @abstractmethod
    def stop(self, agent: str, reason: str) -> int:
        """Save and end the agent's executions; returns how many. Until they have ended, none is given out in their run."""

    @abstractmethod
    def save(self, run: int) -> int:
        """Have the executions of a run save soon; returns how many were asked. Their status is `saving` until they did."""

    @abstractmethod
    def events(self, after: int) -> list[dict[str, Any]]:
        """What happened since event `after`, oldest first: ended, error, saved. Earlier ones are forgotten."""

    def sweep(self) -> None:  # noqa: B027 - where a parent watches over its children, it does this itself
        """Note which executions are dead without a word. Part of the housekeeping."""
