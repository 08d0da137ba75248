"""Other commands of manage.py, each in a fork of this process: it has Django already, and what they load goes with them.

`migrate` may load torch, and 200 MB would stay. Forked while this process has one thread and no open database.
"""

from __future__ import annotations

import io
import json
import multiprocessing
import os
import signal
from multiprocessing.connection import Connection
from typing import Any

from django.core.management import call_command
from django.db import connection

from envs_app.serving.bond import die_with_parent
from envs_app.serving.preflight import StartError
from envs_app.serving.signals import STOP


def manage(command: str, **options: Any) -> str:
    """What a command of manage.py prints. Raises StartError with its reason."""
    context = multiprocessing.get_context("fork")
    answers, answer = context.Pipe(duplex=False)
    process = context.Process(target=_run, args=(command, options, os.getpid(), answer), daemon=True)
    process.start()
    answer.close()
    try:
        printed, reason = answers.recv()
    except EOFError:  # it was killed
        printed, reason = "", None
    process.join()
    if process.exitcode:
        raise StartError(f"manage.py {command} failed: {reason or f'exit code {process.exitcode}'}")
    return printed


def _run(command: str, options: dict[str, Any], parent: int, answer: Connection) -> None:
    """In the fork: run the command and send what it prints, or why it fails."""
    signal.set_wakeup_fd(-1)
    for number in STOP | {signal.SIGCHLD}:  # those of the supervisor
        signal.signal(number, signal.SIG_DFL)
    die_with_parent(parent)
    connection.settings_dict["OPTIONS"].pop("pool", None)  # it would wait, and then not say why there is no connection
    printed = io.StringIO()
    try:
        call_command(command, stdout=printed, **options)
    except Exception as error:
        answer.send(("", " ".join(f"{type(error).__name__}: {error}".split())))
        raise SystemExit(1) from None
    answer.send((printed.getvalue(), None))


def prepare(demo_data: bool, if_new: bool = False) -> dict[str, Any]:
    """Bring the database up to date; with `demo_data`, make what is missing of that and return its new secrets; `if_new`:
    only where nobody has made anything yet."""
    manage("migrate", verbosity=0, interactive=False)
    return json.loads(manage("demo_data", if_new=if_new) or "{}") if demo_data else {}
