"""Where the embedded set-up keeps what is not in the database; no Django, for the parent and the executions."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Places:
    """Paths below the data folder."""

    data: Path

    @classmethod
    def from_environment(cls) -> Places:
        """Below SHEPHERD_DATA; the default is `var` beside manage.py, as in shepherd.settings."""
        default = Path(__file__).resolve().parents[3] / "var"
        return cls(Path(os.environ.get("SHEPHERD_DATA") or default).resolve())

    @property
    def parent(self) -> Path:
        """The socket of the executions' parent."""
        return self.run / "parent.sock"

    @property
    def run(self) -> Path:
        """What only lives as long as the processes."""
        return self.data / "run"

    @property
    def ledger(self) -> Path:
        """The states of sessions."""
        return self.data / "ledger"

    def execution(self, uid: str) -> Path:
        """The socket of an execution."""
        return self.run / f"{uid}.sock"

    def weights(self, run: int, number: int) -> Path:
        """The policy that an execution published."""
        return self.run / f"weights-{run}-{number}"

    @property
    def saves(self) -> Path:
        """The saves of all runs."""
        return self.data / "saves"

    def locate(self, spec: dict[str, Any]) -> dict[str, Any]:
        """The specification of an execution (execution.worker.ExecutionSpec as a dictionary) with its places here."""
        return {**spec, "turns": str(self.run)}
