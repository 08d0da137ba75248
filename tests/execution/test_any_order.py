"""Whatever clients, owners and machines do in whatever order: no step is lost or counted twice, and the learner learns."""

from __future__ import annotations

import random
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envs_app.execution import desk
from tests.execution.station import Station
from tests.execution.test_sessions import assert_whole, watch

SESSIONS = (1, 2, 3, 4)
OPERATIONS = 250


@dataclass
class Known:
    """What a client knows of its session."""

    seq: int = 0
    episode: int = 0
    playing: bool = False
    total: float = 0.0
    length: int = 0
    answer: Any = None


class World:
    """Two executions of a run at a time, sessions that go where there is room, and a model of what must be answered."""

    def __init__(self, folder: Path, algorithm: str, seed: int, stack: ExitStack) -> None:
        self.folder, self.algorithm, self.stack = folder, algorithm, stack
        self.random = random.Random(seed)
        self.known = {session: Known() for session in SESSIONS}
        self.started = 0
        self.tapes: list[list[Any]] = []
        self.stations = [self._start(), self._start()]

    def go_on(self) -> None:
        """Something happens."""
        happens = [self.step] * 12 + [self.end] * 2 + [self.end_at_once, self.repeat, self.skip]
        happens += [self.release, self.switch, self.share, self.save]
        session = self.random.choice(SESSIONS)
        if self.random.random() < 0.02:
            self.replace()
        else:
            self.random.choice(happens)(session)

    # --- what a client does ---
    def step(self, session: int) -> None:
        known, reward = self.known[session], self.random.randint(-4, 4) / 2
        answer = self._send(session, known.seq + 1, reward)
        assert answer["action"] is not None
        if known.playing:
            known.total, known.length = known.total + reward, known.length + 1
        else:
            known.playing, known.total, known.length, known.episode = True, 0.0, 0, known.episode + 1
        known.seq, known.answer = known.seq + 1, answer

    def end(self, session: int) -> None:
        known = self.known[session]
        if not known.playing:
            self.step(session)
        reward, terminated = self.random.randint(-4, 4) / 2, self.random.random() < 0.5
        answer = self._send(session, known.seq + 1, reward, terminated, not terminated)
        episode = answer["episode"]
        assert (episode["return"], episode["length"]) == (known.total + reward, known.length + 1)
        assert episode["number"] == known.episode
        known.seq, known.answer, known.playing = known.seq + 1, answer, False

    def end_at_once(self, session: int) -> None:
        known = self.known[session]
        if known.playing:
            return
        answer = self._send(session, known.seq + 1, 1.0, terminated=True)
        assert (answer["ended"], answer["episode"]) == (True, None)
        known.seq, known.answer = known.seq + 1, answer

    def repeat(self, session: int) -> None:
        if (known := self.known[session]).answer is not None:
            assert self._send(session, known.seq, 77.0) == known.answer

    def skip(self, session: int) -> None:
        if (known := self.known[session]).answer is not None:
            assert self._send(session, known.seq + 2, 77.0)["code"] == "sequence_gap"

    # --- what others do ---
    def release(self, session: int) -> None:
        for station in self.stations:
            station.desk.release(session)

    def switch(self, session: int) -> None:
        for station in self.stations:
            station.worker.set_learning(self.random.random() < 0.7)
            station.desk.wake()

    def share(self, session: int) -> None:
        self.random.choice(self.stations).desk.set_sessions(self.random.randint(1, 3))

    def save(self, session: int) -> None:
        self.random.choice(self.stations).worker.save_now()

    def replace(self) -> None:
        """An execution ends, in order or not, and another one begins."""
        index = self.random.randrange(2)
        ended = self.stations[index]
        ended.desk.abandon()
        assert ended.worker.stop(30)
        assert ended.worker.failure is None, ended.worker.failure
        self.stations[index] = self._start()

    def _send(self, session: int, seq: int, reward: float, terminated: bool = False, truncated: bool = False) -> Any:
        """To an execution that has room."""
        obs = np.array([session / 10, *np.random.uniform(-1, 1, 2)], np.float32)
        for station in self.random.sample(self.stations, 2):
            answer = station.step(session, obs, reward, terminated=terminated, truncated=truncated, seq=seq)
            if answer.get("code") != "busy":
                return answer
        raise AssertionError("an execution is busy, though nobody keeps a place for long")

    def _start(self) -> Station:
        self.started += 1
        facts: dict[str, Any] = {"algorithm": self.algorithm, "reclaim_seconds": 0.0, "sessions": 2}
        if self.algorithm == "ARS":
            facts["sessions"] = 1
        station = self.stack.enter_context(
            Station(self.folder, uid=f"execution {self.started}", number=self.started, **facts)
        )
        if not station.worker.direct:
            self.tapes.append(watch(station))
        return station


def is_read(station: Station) -> bool:
    """Whether the learner has taken all that it was given."""
    return station.worker.feed.backlog == 0


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("algorithm", ["PPO", "DQN", "RecurrentPPO", "ARS"])
def test_nothing_is_lost_or_mixed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, algorithm: str, seed: int) -> None:
    monkeypatch.setattr(desk, "PIECE", 6)
    with ExitStack() as stack:
        world = World(tmp_path, algorithm, seed, stack)
        for _ in range(OPERATIONS):
            world.go_on()
        for station in world.stations:
            station.worker.set_learning(True)
            station.desk.abandon()
            if not station.worker.direct:
                station.wait_until(partial(is_read, station))
    for station in world.stations:
        assert station.worker.failure is None, station.worker.failure
    for tape in world.tapes:
        assert_whole(tape)
