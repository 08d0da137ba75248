"""The fleet that the admin asks (agents_app.fleet.Fleet): the transport's executions and the saves of runs."""

from __future__ import annotations

import time
from datetime import UTC, datetime
from io import BytesIO
from typing import Any, cast

from agents_app.fleet import ExecutionStatus
from agents_app.models import Agent, Run, Save
from envs_app.execution.saves import SaveMeta
from envs_app.handles import handles
from envs_app.saves import clear_saves, prefix_of, saves_of
from envs_app.transports.choice import get_transport

SAVE_SECONDS = 3.0  # how long a download waits for a save that is newer
PAUSE_SECONDS = 0.05


class TransportFleet:
    """Asks the transport; and the storage of saves."""

    def status(self, agent_id: str) -> list[ExecutionStatus]:
        """The live executions of an agent, by number."""
        return cast(list[ExecutionStatus], get_transport().status(str(agent_id)))

    def note_revoked(self) -> None:
        """This process asks the database at the next step of each session; others do within handles.REFRESH_SECONDS."""
        handles.expire()

    def restart(self, agent_id: str) -> int:
        """Save and end all executions of the agent."""
        return get_transport().stop(str(agent_id), "restart")

    def set_learning(self, agent_id: str, enabled: bool) -> None:
        """Let live executions learn, or only act."""
        get_transport().configure(str(agent_id), {"learning": enabled})

    def configure(self, agent_id: str) -> None:
        """Tell live executions of new limits."""
        agent = Agent.objects.get(pk=agent_id)
        limits = {"max_percent_cpu": agent.max_percent_cpu, "save_interval": agent.save_interval}
        get_transport().configure(str(agent_id), {**limits, "sessions": agent.sessions_per_execution})

    def saves(self, run: Run) -> list[dict[str, Any]]:
        """The readable saves of a run, newest first."""
        with saves_of(run) as store:
            return [_described(name, meta, store.size(name)) for name, meta in store.metas()]

    def model_zip(self, run: Run) -> BytesIO | None:
        """The newest good model of a run; executions that are live save first, if their learners can in time."""
        if self._ask_to_save(run):
            deadline = time.monotonic() + SAVE_SECONDS
            while self._is_saving(run) and time.monotonic() < deadline:
                time.sleep(PAUSE_SECONDS)
        with saves_of(run) as store:
            chosen = store.choose("latest")
        return None if chosen is None else chosen.model

    def delete_saves(self, run: Run) -> int:
        """Delete all saves of a run, and their rows."""
        deleted = clear_saves(prefix_of(run))
        Save.objects.filter(run=run).delete()
        return deleted

    def _is_saving(self, run: Run) -> bool:
        """Whether a live execution of the run has not yet saved what it learned until it was asked."""
        statuses = get_transport().status(str(run.agent_id))
        return any(execution["saving"] for execution in statuses if execution["run"] == run.pk)

    def _ask_to_save(self, run: Run) -> int:
        try:
            return get_transport().save(run.pk)
        except OSError:
            return 0  # nothing runs: what is saved is what there is


def _described(name: str, meta: SaveMeta, size: int) -> dict[str, Any]:
    facts = {"name": name, "execution": meta.execution, "steps": meta.steps, "mean_return": meta.mean_return}
    return facts | {"size": size, "created_at": datetime.fromtimestamp(meta.created_at, UTC)}
