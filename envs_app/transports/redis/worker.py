"""The Celery worker's side: a warmed main process of one thread, from which each execution is forked; and what watches over them.

The main process has imported torch and trained before it forks its pool, so that a child shares that memory. A child serves one
execution and ends. The main process says once a second that it lives and how many slots it has, and buries the executions that
were killed, at once: their callers wait no longer than it takes to say so.
"""

from __future__ import annotations

import contextlib
import logging
import os
import re
import signal
import socket
import time
from pathlib import Path
from typing import Any

import setproctitle
from billiard.exceptions import WorkerLostError
from celery import bootsteps
from celery.signals import task_failure, worker_process_init
from celery.worker import state as celery_state
from celery.worker.components import Pool
from django.conf import settings
from django.core.files.storage import storages

from envs_app.serving.bond import die_with_parent
from envs_app.transports.local.places import Places
from envs_app.transports.population import why_killed
from envs_app.transports.redis import keys
from envs_app.transports.redis.machines import Room
from envs_app.transports.redis.queues import QUEUES
from envs_app.transports.redis.shared import End, Shared
from envs_app.transports.redis.wire import Unreachable, Wire

BEAT_SECONDS, REAP_SECONDS = 1.0, 0.2
SILENT_SECONDS = 30.0  # without a lease, and an execution is killed: it hangs, or does not come to its end

log = logging.getLogger("shepherd.worker")


def execute(order: dict[str, Any]) -> None:
    """The life of an execution, in a forked child."""
    from envs_app.execution.worker import ExecutionSpec
    from envs_app.transports.redis.child import RedisChild
    from envs_app.transports.redis.condition import Place

    parent = os.getppid()
    die_with_parent(parent)
    spec, places = order["spec"], Places(Path(settings.DATA_DIR))
    setproctitle.setproctitle(f"shepherd: execution {spec['number']} of {spec['agent_id']}")
    places.run.mkdir(parents=True, exist_ok=True)
    place = Place(
        pid=os.getpid(),
        machine=os.uname().nodename,
        queue=order["queue"],
        percent=order["percent"],
        idle_seconds=settings.IDLE_SECONDS,
        ledger_seconds=settings.SESSION_DAYS * 86400.0,
    )
    execution = ExecutionSpec.from_dict(places.locate(spec))
    RedisChild(execution, Wire(settings.REDIS_URL), place, storages["saves"]).live()
    if os.getppid() != parent:
        os._exit(0)  # the worker was killed: Celery's pool would wait for it, and nobody waits for this process


class Machine(bootsteps.StartStopStep):
    """Says that this machine lives, and watches over its executions; in the loop of the worker's main process."""

    requires = (Pool,)

    def __init__(self, worker: Any, **options: Any) -> None:
        super().__init__(worker, **options)
        self.queues = [name for name in QUEUES if name in worker.app.amqp.queues.consume_from]
        self.enabled = bool(self.queues)
        self.name, self.slots = worker.hostname, worker.concurrency
        self.silent: dict[str, float] = {}  # executions without a lease, since when
        self.hung: set[str] = set()  # those that were killed for it
        self.watching = self.leaving = False

    def start(self, worker: Any) -> None:
        """Nothing yet: the loop comes later."""
        threads = len(list(Path("/proc/self/task").iterdir()))
        if threads > 1:
            log.warning("the worker's main process has %d threads: what it forks may hang", threads)

    def register_with_event_loop(self, worker: Any, hub: Any) -> None:
        """Called each time that the worker has reached the broker: when it loses it, Celery ends what is called repeatedly."""
        if not self.enabled:
            return
        if not self.watching:
            self._begin()
        self._tick(worker)
        hub.call_repeatedly(BEAT_SECONDS, self._tick, worker)
        hub.call_repeatedly(REAP_SECONDS, worker.pool.maintain_pool)  # Celery itself looks for the lost every 5 s

    def _begin(self) -> None:
        self.watching = True
        self.wire = Wire(settings.REDIS_URL)
        self.shared, self.room = Shared(self.wire), Room(self.wire)
        task_failure.connect(self._on_failure, weak=False)

    def stop(self, worker: Any) -> None:
        """A warm shutdown: take no more, and have the executions save and end; the pool waits for them."""
        self.leaving = True
        if self.watching:
            self._leave()
        for request in list(celery_state.active_requests):
            _signal(request.worker_pid, signal.SIGTERM)

    terminate = stop

    def _leave(self) -> None:
        try:
            self.room.leave(self.name)
        except Unreachable as error:
            log.warning("nobody can be told that this worker ends: %s", error)

    def _tick(self, worker: Any) -> None:
        if self.leaving:
            return
        try:
            self.room.beat(self.name, self.queues, self.slots)
            self._kill_silent()
        except Unreachable as error:
            log.warning("the worker gives no sign of life: %s", error)
            self.silent.clear()

    def _on_failure(self, exception: Exception, task_id: str, args: list[Any], **_: Any) -> None:
        """A child was killed; what fails by itself has said so."""
        if isinstance(exception, WorkerLostError):
            self._bury(task_id, args[0], exit_code(str(exception)))

    def _kill_silent(self) -> None:
        running = {request.id: request.worker_pid for request in celery_state.active_requests}
        leases = self.wire.ask(*(("EXISTS", keys.lease(uid)) for uid in running)) if running else []
        now = time.monotonic()
        lost = {uid for uid, lives in zip(running, leases, strict=True) if not lives}
        self.silent = {uid: self.silent.get(uid, now) for uid in lost}
        for uid, since in self.silent.items():
            if now - since > SILENT_SECONDS:
                log.error("execution %s hangs and is killed", uid)
                self.hung.add(uid)
                _signal(running[uid], signal.SIGKILL)

    def _bury(self, uid: str, order: dict[str, Any], code: int) -> None:
        """An execution was killed; one that was ready is replaced at once, those that die at the start make their agent wait."""
        spec = order["spec"]
        where = {"uid": uid, "agent": spec["agent_id"], "run": spec["run"], "at": time.time()}
        summary = why_killed(code) if uid not in self.hung else f"the execution hung for {SILENT_SECONDS:g} s"
        try:
            known = self.shared.load(spec["agent_id"]).by_uid.get(uid)  # unless somebody else has buried it
            failed = code != -signal.SIGKILL or (known is not None and known.state == "starting")
            self.shared.event({"k": "error", "summary": summary, "traceback": "", "fatal": True, **where})
            self.shared.bury(
                End(uid, spec["number"], spec["run"], spec["agent_id"], order["queue"], "crash", code, failed)
            )
        except Unreachable as error:  # its lease ends, and the housekeeping finds it dead
            log.error("execution %s was killed, and nobody could be told: %s", uid, error)


def exit_code(text: str) -> int:
    """Of a process that Celery says was lost: 'Worker exited prematurely: signal 9 (SIGKILL) Job: 0.'"""
    signalled, exited = re.search(r"signal (\d+)", text), re.search(r"exitcode (\d+)", text)
    return -int(signalled[1]) if signalled else int(exited[1]) if exited else 1


def _signal(pid: int | None, number: int) -> None:
    if pid:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)


def prepare(worker: Any) -> None:
    """Warm up before the pool is forked, and watch over what is forked."""
    import envs_app.transports.redis.child  # noqa: F401
    from envs_app.transports.warmth import warm_up

    warm_up()
    worker_process_init.connect(let_go_of_connections, weak=False)
    worker.app.steps["worker"].add(Machine)


def let_go_of_connections(**_: Any) -> None:
    """In a child of the pool: the main process's connections are not its own.

    While a child has them open, Redis does not see that the main process was killed, and hands the next task to the dead. What
    takes their place keeps their numbers: objects that were inherited, too, will close them one day.
    """
    nothing = os.open(os.devnull, os.O_RDWR)
    for number in [int(path.name) for path in Path("/proc/self/fd").iterdir()]:
        if _is_connection(number):
            os.dup2(nothing, number)
    os.close(nothing)


def _is_connection(number: int) -> bool:
    """Whether a descriptor is a stream to somewhere; those of the pool's own pipes have no name."""
    try:
        with socket.socket(fileno=os.dup(number)) as found:
            return found.type == socket.SOCK_STREAM and bool(found.getpeername())
    except OSError:
        return False
