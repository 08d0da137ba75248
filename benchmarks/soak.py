"""Ten minutes of sixteen clients, and what grows meanwhile: memory, descriptors, processes, files."""

from __future__ import annotations

import os
import statistics
import threading
import time
from contextlib import suppress
from dataclasses import asdict, dataclass

import psutil

from benchmarks.crowd import Load, run_clients
from benchmarks.report import Line, Result
from benchmarks.rig import make_agent
from tests.servers import Server, running_server

SECONDS, EVERY = 600.0, 5.0
# The last two minutes are compared with the fifth and the sixth. Until then all is new: each thread of a web process connects to
# the database when it first ends an episode, and executions write the first of the saves that are kept.
FULL, SPELL = 240.0, 120.0
MEMORY_BAR, COUNT_BAR = 1.05, 1.02  # the last spell beside the earlier one; a connection more or less is no leak
SAVES_KEPT = 2  # of each execution: as many as there will ever be are there soon


@dataclass(frozen=True)
class Sample:
    """The server at one moment."""

    seconds: float
    memory_mb: float  # of all its processes, what they share once; executions share less and less of what they inherit
    execution_mb: float  # of one, what it shares included
    web_mb: float  # of one web process, likewise
    processes: int
    descriptors: int
    files: int  # in its data folder


def run() -> Result:
    """The row."""
    with running_server(SHEPHERD_SAVES_KEPT=SAVES_KEPT) as server:
        watch = Watch(server)
        load = run_clients(server, make_agent(server, save_interval=2000), "step", SECONDS)
        samples = watch.stop()
    numbers = {"load": load.summary(), "samples": [asdict(sample) for sample in samples]}
    return Result("soak", lines(load, samples), numbers)


def lines(load: Load, samples: list[Sample]) -> list[Line]:
    """What the load was, and each count in the earlier spell and in the last."""
    end = samples[-1].seconds
    early = [sample for sample in samples if FULL <= sample.seconds < FULL + SPELL]
    late = [sample for sample in samples if sample.seconds >= end - SPELL]
    what = f"{load.calls} steps, {load.rate:.0f}/s, longest {load.longest:.2f} s, {len(load.errors)} failed"
    return [
        Line(f"16 clients for {end / 60:.0f} minutes", what, "none fails", not load.errors),
        _growth("memory of an execution, with what it shares, MB", "execution_mb", early, late, MEMORY_BAR),
        _growth("memory of a web process, with what it shares, MB", "web_mb", early, late, MEMORY_BAR),
        _growth("memory of all processes, what they share once, MB", "memory_mb", early, late, None),
        _growth("processes", "processes", early, late, COUNT_BAR),
        _growth("open descriptors", "descriptors", early, late, COUNT_BAR),
        _growth("files in the data folder", "files", early, late, COUNT_BAR),
    ]


def _growth(what: str, name: str, early: list[Sample], late: list[Sample], bar: float | None) -> Line:
    """By medians: a save that is just being written is one file more."""
    before, after = (statistics.median(getattr(sample, name) for sample in spell) for spell in (early, late))
    measured = f"{before:.0f} in minutes 5 and 6, {after:.0f} in the last two"
    return Line(what, measured) if bar is None else Line(what, measured, f"≤ {bar:g} times", after <= bar * before)


class Watch:
    """Takes samples, in a thread."""

    def __init__(self, server: Server) -> None:
        self.server, self.ended, self.samples = server, threading.Event(), list[Sample]()
        self.begun = time.monotonic()
        self.thread = threading.Thread(target=self._watch, daemon=True)
        self.thread.start()

    def stop(self) -> list[Sample]:
        """All of them."""
        self.ended.set()
        self.thread.join()
        return self.samples

    def _watch(self) -> None:
        while not self.ended.wait(EVERY):
            with suppress(psutil.Error, OSError):  # a process or a file went while it was looked at
                self.samples.append(self._sample())

    def _sample(self) -> Sample:
        processes = self.server.processes()
        return Sample(
            seconds=round(time.monotonic() - self.begun, 1),
            memory_mb=round(sum(process.memory_full_info().pss for process in processes) / 2**20, 1),
            execution_mb=_resident(self.server.execution_pids()),
            web_mb=_resident(self.server.web_pids()),
            processes=len(processes),
            descriptors=sum(process.num_fds() for process in processes),
            files=sum(len(names) for _, _, names in os.walk(self.server.data)),
        )


def _resident(pids: list[int]) -> float:
    """Megabytes of one of these, on the average."""
    return round(statistics.mean([psutil.Process(pid).memory_info().rss / 2**20 for pid in pids] or [0.0]), 1)
