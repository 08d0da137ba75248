"""The Celery application: executions as tasks, and housekeeping by the clock.

celery -A shepherd worker -Q small,large                        executions, SHEPHERD_SLOTS at once
celery -A shepherd worker --beat --pool solo -Q housekeeping    housekeeping
"""

from __future__ import annotations

import logging.config
import os
from functools import cache
from typing import Any

os.environ.setdefault("DJANGO_SETTINGS_MODULE", "shepherd.settings")

from celery import Celery
from celery.app.amqp import AMQP
from celery.signals import setup_logging, worker_init
from django.conf import settings
from kombu import Connection, Exchange, Queue

from envs_app.serving.housekeeping import Housekeeper
from envs_app.transports.redis.queues import QUEUES

HOUSEKEEPING = "housekeeping"


class Broker(Connection):
    """Is there again soon after Redis is: Celery itself waits for 2, 4, up to 30 seconds between two attempts, all of which a
    client waits whose execution is to begin."""

    FIRST, MORE, LONGEST = 0.1, 0.1, 1.0  # seconds

    def ensure_connection(self, *args: Any, **options: Any) -> Connection:
        """Try until there is a connection, as `kombu.Connection` does."""
        pauses = {"interval_start": self.FIRST, "interval_step": self.MORE, "interval_max": self.LONGEST}
        return super().ensure_connection(*args, **pauses | options)


class Messages(AMQP):
    """What Celery sends and receives, by our connection."""

    Connection = Broker


app = Celery("shepherd", broker=settings.REDIS_URL, amqp=Messages)
app.conf.update(
    # A task is an execution and lives for hours: acknowledged as it begins, never handed out twice, none held back for later.
    task_acks_late=False,
    worker_prefetch_multiplier=1,
    worker_disable_prefetch=True,
    worker_concurrency=settings.SLOTS,
    worker_max_tasks_per_child=1,
    worker_cancel_long_running_tasks_on_connection_loss=False,
    worker_proc_alive_timeout=60.0,  # many children may begin at once
    worker_lost_wait=0.2,  # seconds until the slot of a killed child is free again
    task_ignore_result=True,
    task_queues=[Queue(name, Exchange(name), routing_key=name) for name in (*QUEUES, HOUSEKEEPING)],
    task_default_queue=QUEUES[0],
    task_create_missing_queues=False,
    task_serializer="json",
    accept_content=["json"],
    broker_connection_retry_on_startup=True,
    broker_connection_max_retries=None,
    broker_transport_options={
        "global_keyprefix": "shepherd:celery:",
        "socket_timeout": 5.0,
        "socket_connect_timeout": 3.0,
    },
    worker_enable_remote_control=False,
    worker_send_task_events=False,
    worker_hijack_root_logger=False,
    timezone="UTC",
    beat_schedule={
        "keep house": {
            "task": "shepherd.housekeeping",
            "schedule": 1.0,
            "options": {"queue": HOUSEKEEPING, "expires": 5.0},
        }
    },
    beat_schedule_filename=str(settings.DATA_DIR / "run" / "beat"),
)


@worker_init.connect
def _prepare(sender: Any, **_: Any) -> None:
    """If this worker runs executions: warm up before the pool is forked, and watch over them."""
    if set(QUEUES) & set(app.amqp.queues.consume_from):
        from envs_app.transports.redis import worker

        worker.prepare(sender)


@setup_logging.connect
def _log_as_django_does(**_: Any) -> None:
    """Celery leaves the logs alone, and does not write down each round of the housekeeping."""
    logging.config.dictConfig(settings.LOGGING)
    for name in ("celery.beat", "celery.worker.strategy", "celery.app.trace"):
        logging.getLogger(name).setLevel("WARNING")


@app.task(name="shepherd.execution")
def execution(order: dict[str, Any]) -> None:
    """Be an execution until it is over (envs_app.transports.redis.worker)."""
    from envs_app.transports.redis import worker

    worker.execute(order)


@app.task(name="shepherd.housekeeping", expires=5.0)
def housekeeping() -> None:
    """One round."""
    _housekeeper().once()


@cache
def _housekeeper() -> Housekeeper:
    """One for the life of this process: it remembers which errors it has logged."""
    return Housekeeper()


def enqueue(order: dict[str, Any], uid: str, queue: str) -> None:
    """Have a worker start an execution. Raises when the broker does not take the task."""
    execution.apply_async(args=[order], task_id=uid, queue=queue, expires=order["expires"])
