"""Plays what is missing of some figures, on several cores: a process per run, with one torch thread.

A run whose result is there is not played again; an advisor that is there is not trained again.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tqdm import tqdm

from experiments import results as files
from experiments.figure import Figure

_played: Any = None  # in a process of the pool: episodes of all of them together


@dataclass(frozen=True)
class Job:
    """One run to play."""

    path: Path
    task: Any
    seed: int
    saves: Path

    @property
    def episodes(self) -> int:
        """How many it plays, of all its executions together."""
        return self.task.episodes * getattr(self.task, "clients", 1)

    def run(self) -> None:
        """Play and keep the result; or take it from a figure that has the same curve."""
        if files.borrow(self.path, self.task, self.seed):
            return
        start = time.monotonic()
        executions = self.task.learn(self.seed, self.saves, count_episode)
        files.write(self.path, self.task, self.seed, executions, time.monotonic() - start)


@dataclass(frozen=True)
class Batch:
    """Runs of one curve that one process plays at once, since that is cheaper."""

    jobs: tuple[Job, ...]

    def run(self) -> None:
        """Play all that no other figure has, and keep the results."""
        task = self.jobs[0].task
        jobs = [job for job in self.jobs if not files.borrow(job.path, task, job.seed)]
        if not jobs:
            return
        start = time.monotonic()
        runs = task.learn_together([job.seed for job in jobs], count_episode)
        seconds = (time.monotonic() - start) / len(jobs)
        for job, executions in zip(jobs, runs, strict=True):
            files.write(job.path, task, job.seed, executions, seconds)


@dataclass(frozen=True)
class Training:
    """One advisor to train."""

    name: str
    saves: Path
    steps: int | None
    episodes: int = 0

    def run(self) -> None:
        """Train and keep it."""
        from experiments import advisors

        advisors.train(self.name, self.saves, self.steps)


def missing(figures: Iterable[Figure], results: Path) -> list[Job]:
    """The runs that have no result yet: first seeds of all curves first, so that all of a figure shows early."""
    jobs = [
        Job(path, task, seed, results / "advisors")
        for figure in figures
        for panel in figure.panels
        for seed in range(figure.runs_of(panel))
        for curve, task in panel.curves.items()
        if files.read(path := files.path_of(results, figure, panel, curve, seed), task) is None
    ]
    return sorted(jobs, key=lambda job: job.seed)


def batched(jobs: list[Job]) -> list[Job | Batch]:
    """The same; those whose task can play many seeds at once are together, where the first of them was."""
    groups: dict[Any, list[Job]] = {}
    for job in jobs:
        alone = not hasattr(job.task, "learn_together")
        groups.setdefault(job.path if alone else (job.path.parent, repr(job.task)), []).append(job)
    return [Batch(tuple(group)) if hasattr(group[0].task, "learn_together") else group[0] for group in groups.values()]


def untrained(jobs: Iterable[Job], steps: int | None) -> list[Training]:
    """The advisors that these runs need and that are not there."""
    wanted = dict.fromkeys((name, job.saves) for job in jobs for name in job.task.advisors)
    return [Training(name, saves, steps) for name, saves in wanted if files.advisor_return(saves, name) is None]


def play(figures: Iterable[Figure], results: Path, processes: int, advisor_steps: int | None = None) -> list[str]:
    """Play what is missing. Returns what failed, with tracebacks; the others are played all the same."""
    jobs = missing(figures, results)
    with _pool(processes) as (pool, played), _bar(jobs) as bar:
        failed = _all(pool, untrained(jobs, advisor_steps), bar, lambda: 0)
        return failed or _all(pool, batched(jobs), bar, lambda: played.value)


def count_episode() -> None:
    """Move the bar by one episode."""
    if _played is not None:
        with _played.get_lock():
            _played.value += 1


def _all(pool: ProcessPoolExecutor, jobs: Sequence[Any], bar: tqdm[Any], count: Callable[[], int]) -> list[str]:
    """Run the jobs; what failed."""
    futures = {pool.submit(_run, job): job for job in jobs}
    left: set[Future[str]] = set(futures)
    while left:
        done, left = wait(left, timeout=1)
        bar.set_postfix_str(f"{len(left)} of {len(jobs)} left", refresh=False)
        bar.update(count() - bar.n)
        bar.refresh() if done else None
    return [text for future in futures if (text := future.result())]


def _run(job: Job | Batch | Training) -> str:
    """In a process of the pool: the traceback, or nothing."""
    try:
        job.run()
    except Exception:
        return f"{job}\n{traceback.format_exc()}"
    except BaseException:  # interrupted: the next job, which the pool has handed out already, must not begin
        os._exit(143)
    return ""


@contextmanager
def _pool(processes: int) -> Iterator[tuple[ProcessPoolExecutor, Any]]:
    """Processes that have started anew, and the number of episodes that they have played."""
    # Read by libraries when they are loaded, torch among them: each process has one thread.
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))
    context = multiprocessing.get_context("spawn")
    played = context.Value("q", 0)
    pool = ProcessPoolExecutor(processes, context, initializer=_begin, initargs=(played,))
    try:
        yield pool, played
    except BaseException:  # interrupted: what runs now may take an hour more
        for process in multiprocessing.active_children():
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _begin(played: Any) -> None:
    global _played
    _played = played
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # through every `with`: no server is left behind
    warnings.filterwarnings("ignore", message=".*out of date.*")  # Cart Pole v0 is the one of the thesis


def _bar(jobs: list[Job]) -> tqdm[Any]:
    """A bar over episodes; where nobody watches a terminal, a line now and then."""
    every = 0.5 if sys.stderr.isatty() else 60.0
    return tqdm(total=sum(job.episodes for job in jobs), unit=" episodes", mininterval=every, dynamic_ncols=True)
