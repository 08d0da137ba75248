"""The supervisor's parts: logs that stay short, housekeeping that survives, pauses that grow."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from django.db import OperationalError
from django.utils import timezone

from envs_app import housekeeping as rounds
from envs_app.serving import bond, logs
from envs_app.serving.child import LONGEST_DELAY, Child
from envs_app.serving.housekeeping import Housekeeper
from tests.agents.makers import make_agent
from tests.servers import wait_for


def test_a_long_log_is_moved_away_and_its_writer_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(logs, "LARGEST", 10)
    kept = logs.Logs(tmp_path)
    with kept.open("web") as web:
        web.write(b"a long line\n")
        kept.rotate()
        web.write(b"short\n")
        kept.rotate()
    assert (tmp_path / "web.log").read_text() == "short\n"
    assert (tmp_path / "web.log.1").read_text() == "a long line\n"
    assert kept.tail("web") == "short"


def test_housekeeping_survives_a_locked_database(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    done: list[str] = []

    def locked_twice() -> None:
        done.append("round")
        if len(done) < 3:
            raise OperationalError("database is locked")

    monkeypatch.setattr(rounds, "run_once", locked_twice)
    keeper = Housekeeper()
    keeper.hurry()
    with caplog.at_level("ERROR", logger="shepherd.serve"):
        keeper.start()
        wait_for(lambda: len(done) > 3)
        keeper.stop(timeout=10)
    assert not keeper.thread.is_alive()
    assert [record.getMessage() for record in caplog.records] == ["housekeeping failed, and will be tried again"]


def test_what_keeps_dying_is_started_after_longer_and_longer_pauses(tmp_path: Path) -> None:
    child = Child("nothing", "there.is.no.such.module", [], [], (tmp_path / "log").open("ab"))
    pauses = []
    for _ in range(3):
        child.start(dict(os.environ), tmp_path)
        assert wait_for(child.has_died) == 1
        pauses.append(child.start_at - time.monotonic())
        assert not child.is_due()
    assert pauses == sorted(pauses)
    assert pauses[-1] < LONGEST_DELAY
    assert "No module named 'there'" in (tmp_path / "log").read_text()


STUBBORN = "import signal, time; signal.signal(15, signal.SIG_IGN); print(1); time.sleep(600)"
MOTHER = f"""
import subprocess, sys, time
subprocess.Popen([sys.executable, "-c", {STUBBORN!r}])
time.sleep(600)
"""


def test_a_killed_child_takes_what_it_started_with_it(tmp_path: Path) -> None:
    """Even what ignores SIGTERM: it is killed when its time is over."""
    (tmp_path / "mother.py").write_text(MOTHER)
    child = Child("mother", "mother", [], [], (tmp_path / "log").open("ab"))
    child.start(dict(os.environ) | {"PYTHONUNBUFFERED": "1"}, tmp_path)
    wait_for((tmp_path / "log").read_text, what="the grandchild")
    group = child.pid
    assert group and child.process
    child.process.kill()
    assert wait_for(child.has_died) == -9
    assert not child.is_gone()
    child.kill()
    wait_for(child.is_gone)
    with pytest.raises(ProcessLookupError):
        os.killpg(group, 0)


BINDING = f"""
import os, subprocess, sys, time
command = [sys.executable, {bond.__file__!r}, str(os.getpid()), sys.executable, "-c", "import time; time.sleep(600)"]
print(subprocess.Popen(command).pid, flush=True)
time.sleep(600)
"""


def test_a_bound_process_ends_with_the_one_that_started_it() -> None:
    mother = subprocess.Popen([sys.executable, "-c", BINDING], stdout=subprocess.PIPE, text=True)
    assert mother.stdout
    bound = int(mother.stdout.readline())
    wait_for(lambda: "time.sleep" in cmdline(bound), what="the bound process")
    mother.kill()
    mother.wait()
    wait_for(lambda: not cmdline(bound), what="its end")


def cmdline(pid: int) -> str:
    """The command line of a living process."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_text()
    except OSError:
        return ""


def test_the_end_of_a_log_that_goes_to_the_terminal_is_empty() -> None:
    kept: Any = logs.Logs(None)
    assert kept.tail("web") == ""
    kept.rotate()


@pytest.mark.django_db
def test_an_execution_that_was_taken_for_lost_and_speaks_again_did_not_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rounds, "sync_saves", lambda run: None)
    begun = timezone.now() - 2 * rounds.GRACE
    run = make_agent("cut off").current_run()
    back, _, idle = (run.executions.create(number=number, started_at=begun) for number in (1, 2, 3))
    type(idle).objects.filter(pk=idle.pk).update(ended_at=begun, end_reason="idle")
    rounds.note_lost([])
    rounds.note_found([])
    assert list(run.executions.order_by("number").values_list("end_reason", flat=True)) == ["lost", "lost", "idle"]
    rounds.note_found([{"uid": str(back.uid)}, {"uid": str(idle.uid)}])
    assert list(run.executions.filter(ended_at=None)) == [back]
    assert list(run.executions.order_by("number").values_list("end_reason", flat=True)) == ["", "lost", "idle"]
