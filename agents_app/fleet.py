"""What the admin and the pages ask of the running executions.

`agents_app` must not import `envs_app`, so the fleet is named by the setting SHEPHERD_FLEET and imported on first use.
"""

from __future__ import annotations

from functools import cache
from io import BytesIO
from typing import Any, Protocol, TypedDict

from django.conf import settings
from django.utils.module_loading import import_string


class ExecutionStatus(TypedDict, total=False):
    """What a live execution says of itself. Absent keys are not known yet."""

    uid: str  # agents_app.models.Execution.uid
    number: int
    run: int  # primary key of the run
    agent: str
    pid: int
    state: str  # starting, acting, waiting, stopping
    started_at: float  # seconds since the epoch
    sessions: int  # sessions in the middle of an episode
    episodes: int
    steps: int
    steps_per_second: float
    updates: int  # of the learner
    mean_return: float | None  # over the last 100 episodes
    cpu_percent: float
    memory: int  # private bytes
    advisors: list[int | str]  # whose advice it takes now: numbers of executions, the name of an agent
    advises: list[int]  # numbers of the executions that take its advice now


class Fleet(Protocol):
    """The executions of all agents, wherever they run. Every method may raise ConnectionError when none can be asked."""

    def status(self, agent_id: str) -> list[ExecutionStatus]:
        """The live executions of an agent, by number."""
        ...

    def note_revoked(self) -> None:
        """Something was revoked: believe nothing of sessions that was read before now."""
        ...

    def restart(self, agent_id: str) -> int:
        """Save and end all executions of the agent; the next step of each session starts new ones. Returns how many."""
        ...

    def set_learning(self, agent_id: str, enabled: bool) -> None:
        """Let the agent's live executions learn, or only act, from now on."""
        ...

    def configure(self, agent_id: str) -> None:
        """Tell the live executions of new limits (CPU, cap, sessions per execution) of the agent, read from the database."""
        ...

    def saves(self, run: Any) -> list[dict[str, Any]]:
        """The good saves of a run, newest first: name, execution (uid), steps, mean_return, size, created_at."""
        ...

    def model_zip(self, run: Any) -> BytesIO | None:
        """The newest model of a run as a stock Stable-Baselines3 ZIP, saved now if an execution is live; None: no save."""
        ...

    def delete_saves(self, run: Any) -> int:
        """Delete all saves of a run. Returns how many."""
        ...


@cache
def get_fleet() -> Fleet:
    """The fleet that the settings name."""
    return import_string(settings.SHEPHERD_FLEET)()
