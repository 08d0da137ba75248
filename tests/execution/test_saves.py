"""Saves are whole or not there; the newest good one, or the best one, is found; old ones go: in every kind of storage."""

from __future__ import annotations

import errno
import json
import time
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from django.core.files.storage import InMemoryStorage

from envs_app.execution.saves import LITTER_SECONDS, META, MODEL, MOST, SaveMeta, SaveStore
from envs_app.execution.storage import Folder, Storage
from tests.storages import Pathless

STORAGES: dict[str, Callable[[Path], Storage]] = {
    "folder": Folder,
    "storage without paths": Pathless,
    "memory": lambda _: InMemoryStorage(),
}


@pytest.fixture(params=STORAGES)
def storage(request: pytest.FixtureRequest, tmp_path: Path) -> Storage:
    """An empty one."""
    return STORAGES[request.param](tmp_path / "saves")


@pytest.fixture
def store(storage: Storage) -> SaveStore:
    """No saves yet."""
    return SaveStore(storage, "agent/1")


def put(store: SaveStore, name: str, file: str, content: bytes) -> None:
    """Have a file of a save hold something else."""
    path = f"{store.prefix}/{name}/{file}"
    store.storage.delete(path)
    store.storage.save(path, BytesIO(content))


def save(store: SaveStore, steps: int, mean_return: float | None = None, execution: str = "a" * 32) -> str:
    """A save whose model says its steps."""
    meta = SaveMeta(execution, 1, steps, updates=steps, episodes=1, mean_return=mean_return)
    return store.write(meta, lambda model: model.write(f"model of {steps}".encode()))


def steps_of(store: SaveStore) -> list[int]:
    """Newest first."""
    return [meta.steps for _, meta in store.metas()]


def test_there_is_nothing_to_choose_at_first(store: SaveStore) -> None:
    assert store.names() == []
    assert store.choose("latest") is None
    assert store.choose("best") is None


def test_what_is_saved_is_read_again(store: SaveStore) -> None:
    extra: dict[str, Any] = {"exploration_rate": 0.3}
    meta = SaveMeta("a" * 32, 2, 500, updates=30, episodes=7, mean_return=1.5, recent_returns=[1.0, 2.0], extra=extra)
    name = store.write(meta, lambda model: model.write(b"weights"))
    chosen = store.choose("latest")
    assert chosen is not None
    assert (chosen.name, chosen.meta, chosen.model.getvalue()) == (name, meta, b"weights")
    assert store.size(name) == len(b"weights")


def test_the_newest_is_chosen(store: SaveStore) -> None:
    names = [save(store, steps) for steps in (10, 20, 30)]
    assert store.names() == names[::-1]
    chosen = store.choose("latest")
    assert chosen is not None
    assert (chosen.name, chosen.model.getvalue()) == (names[2], b"model of 30")


def test_one_that_stopped_learning_long_ago_is_not_the_newest_though_it_was_saved_last(store: SaveStore) -> None:
    saved = [save(store, steps) for steps in (10, 20)]
    for steps, idle in ((31, 0.0), (32, 2000.0), (33, 1000.0)):
        meta = SaveMeta("b" * 32, 2, steps, updates=1, episodes=1, mean_return=None, idle=idle)
        saved.append(store.write(meta, lambda model: model.write(b"another")))
    assert steps_of(store) == [31, 20, 10, 33, 32]
    assert store.names() == saved[::-1]
    chosen = store.choose("latest")
    assert chosen is not None
    assert chosen.meta.steps == 31
    store.prune(2)
    assert steps_of(store) == [31, 20, 10, 33]


def test_to_know_the_newest_others_are_not_read(store: SaveStore, monkeypatch: pytest.MonkeyPatch) -> None:
    newest = [save(store, steps) for steps in range(10)][-1]
    other, read = SaveStore(store.storage, store.prefix), []
    monkeypatch.setattr(other, "_read", lambda name, file: read.append(name) or store._read(name, file))
    chosen = other.choose("latest")
    assert chosen is not None
    assert (chosen.name, read) == (newest, [newest, newest])  # its description, and its model


def test_what_others_deleted_is_forgotten(store: SaveStore) -> None:
    other = SaveStore(store.storage, store.prefix)
    for steps in range(20):
        save(store, steps)
        other.prune(3)
    assert len(list(store.metas())) == 3
    assert len(store._metas) == 3


def test_the_newest_is_the_newest_though_the_clock_was_set_back(
    store: SaveStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    for steps in range(1, 4):
        save(store, steps)
    hour_ago = time.time() - 3600
    monkeypatch.setattr(time, "time", lambda: hour_ago)
    for steps in range(4, 9):
        save(store, steps)
        store.prune(2)
        assert steps_of(store) == [steps, steps - 1]


def test_the_best_is_chosen_when_asked_for(store: SaveStore) -> None:
    for steps, mean_return in ((10, -5.0), (20, 7.0), (30, None), (40, 3.0)):
        save(store, steps, mean_return)
    chosen = store.choose("best")
    assert chosen is not None
    assert chosen[1].steps == 20


def test_of_saves_without_a_return_the_newest_is_the_best(store: SaveStore) -> None:
    for steps in (10, 20):
        save(store, steps)
    chosen = store.choose("best")
    assert chosen is not None
    assert chosen[1].steps == 20


@pytest.mark.parametrize("damage", ["cut", "changed", "no model", "no description", "no JSON", "strange description"])
def test_a_damaged_save_is_passed_over(store: SaveStore, damage: str) -> None:
    save(store, 10)
    name = save(store, 20)
    match damage:
        case "cut":
            put(store, name, MODEL, b"mod")
        case "changed":
            put(store, name, MODEL, b"model of 99")
        case "no model":
            store.storage.delete(f"{store.prefix}/{name}/{MODEL}")
        case "no description":
            store.storage.delete(f"{store.prefix}/{name}/{META}")
        case "no JSON":
            put(store, name, META, b'{"execution": ')
        case "strange description":
            put(store, name, META, json.dumps({"steps": 20}).encode())
    chosen = store.choose("latest")
    assert chosen is not None
    assert chosen[1].steps == 10


@pytest.mark.parametrize("file", [MODEL, META])
def test_a_storage_that_is_full_keeps_no_half_save(
    store: SaveStore, monkeypatch: pytest.MonkeyPatch, file: str
) -> None:
    older, save_whole = save(store, 10), store.storage.save

    def save_half(name: str, content: BytesIO) -> str:
        if not name.endswith(file):
            return save_whole(name, content)
        save_whole(name, BytesIO(content.getvalue()[:4]))
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(store.storage, "save", save_half)
    with pytest.raises(OSError, match="No space"):
        save(store, 20)
    assert store.storage.listdir(store.prefix) == ([older], [])
    assert steps_of(store) == [10]


def test_a_save_appears_only_when_it_is_whole(store: SaveStore, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever looks between any two calls of the storage sees none, or all of it."""
    seen: list[list[int]] = []
    save_it = store.storage.save

    def look(name: str, content: BytesIO) -> str:
        seen.append(steps_of(store))
        return save_it(name, content)

    monkeypatch.setattr(store.storage, "save", look)
    save(store, 20)
    assert seen == [[], []]
    assert steps_of(store) == [20]


def test_a_deleted_save_is_none_from_the_first_moment(store: SaveStore, monkeypatch: pytest.MonkeyPatch) -> None:
    name, delete_it = save(store, 20), store.storage.delete
    seen: list[list[int]] = []

    def look(path: str) -> None:
        delete_it(path)
        seen.append(steps_of(SaveStore(store.storage, store.prefix)))

    monkeypatch.setattr(store.storage, "delete", look)
    store.delete(name)
    assert len(seen) > 1
    assert not any(seen)
    assert store.names() == []


class TestPruning:
    def test_the_newest_of_each_execution_are_kept(self, store: SaveStore) -> None:
        for steps in range(1, 7):
            save(store, steps, execution="a" * 32)
            save(store, 100 + steps, execution="b" * 32)
        store.prune(2)
        assert sorted(steps_of(store)) == [5, 6, 105, 106]

    def test_the_best_is_always_kept(self, store: SaveStore) -> None:
        for steps, mean_return in ((1, 0.0), (2, 9.0), (3, 1.0), (4, 2.0), (5, 3.0)):
            save(store, steps, mean_return)
        store.prune(2)
        assert steps_of(store) == [5, 4, 2]

    def test_a_negative_return_may_be_the_best(self, store: SaveStore) -> None:
        for steps, mean_return in ((1, -200.0), (2, -90.0), (3, -150.0), (4, None)):
            save(store, steps, mean_return)
        store.prune(1)
        assert steps_of(store) == [4, 2]

    def test_many_short_lived_executions_do_not_fill_the_disk(self, store: SaveStore) -> None:
        for number in range(60):
            save(store, number, execution=f"{number:032}")
        store.prune(5)
        assert len(store.names()) == MOST

    def test_what_a_killed_process_left_half_written_goes_later(self, store: SaveStore) -> None:
        save(store, 1)
        long_ago = f"{time.time() - LITTER_SECONDS - 1:017.6f}-{'b' * 8}-7"
        just_now = f"{time.time():017.6f}-{'b' * 8}-8"
        for name in (long_ago, just_now):
            put(store, name, MODEL, b"half")
        store.prune(5)
        assert long_ago not in store.names()
        assert just_now in store.names()
        assert steps_of(store) == [1]

    def test_two_executions_may_prune_at_once(self, store: SaveStore) -> None:
        names = [save(store, steps) for steps in range(4)]
        store.delete(names[0])
        store.delete(names[0])
        assert store.names() == names[:0:-1]
