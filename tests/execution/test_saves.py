"""Saves are whole or not there; the newest good one, or the best one, is found; old ones go."""

from __future__ import annotations

import errno
import json
import os
import time
from pathlib import Path
from typing import Any

import pytest

from envs_app.execution.saves import LITTER_SECONDS, MODEL, SaveMeta, SaveStore


@pytest.fixture
def store(tmp_path: Path) -> SaveStore:
    """No saves yet."""
    return SaveStore(tmp_path / "saves")


def save(store: SaveStore, steps: int, mean_return: float | None = None, execution: str = "a" * 32) -> str:
    """A save whose model says its steps."""
    meta = SaveMeta(execution, 1, steps, updates=steps, episodes=1, mean_return=mean_return)
    return store.write(meta, lambda path: path.write_text(f"model of {steps}"))


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
    name = store.write(meta, lambda path: path.write_text("weights"))
    chosen = store.choose("latest")
    assert chosen is not None
    assert chosen == (name, meta)
    assert store.model(name).read_text() == "weights"


def test_the_newest_is_chosen(store: SaveStore) -> None:
    names = [save(store, steps) for steps in (10, 20, 30)]
    assert store.names() == names[::-1]
    assert store.choose("latest") == (names[2], store.meta(names[2]))


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
    folder = store.folder / save(store, 20)
    match damage:
        case "cut":
            os.truncate(folder / MODEL, 3)
        case "changed":
            (folder / MODEL).write_text("model of 99")
        case "no model":
            (folder / MODEL).unlink()
        case "no description":
            (folder / "meta.json").unlink()
        case "no JSON":
            os.truncate(folder / "meta.json", 20)
        case "strange description":
            (folder / "meta.json").write_text(json.dumps({"steps": 20}))
    chosen = store.choose("latest")
    assert chosen is not None
    assert chosen[1].steps == 10


def test_a_full_disk_leaves_no_half_save(store: SaveStore) -> None:
    save(store, 10)

    def fill(path: Path) -> None:
        path.write_text("half a mod")
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        store.write(SaveMeta("a" * 32, 1, 20, 0, 0, None), fill)
    assert [path.name for path in store.folder.iterdir()] == store.names()
    assert steps_of(store) == [10]


def test_a_save_appears_only_when_it_is_whole(store: SaveStore) -> None:
    seen: list[Any] = []

    def look(path: Path) -> None:
        path.write_text("model")
        seen.append(store.names())

    store.write(SaveMeta("a" * 32, 1, 20, 0, 0, None), look)
    assert seen == [[]]
    assert len(store.names()) == 1


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
        assert len(store.names()) == 50

    def test_what_a_killed_process_left_half_written_goes_later(self, store: SaveStore) -> None:
        save(store, 1)
        old, new = store.folder / ".old", store.folder / ".new"
        for folder in (old, new):
            folder.mkdir()
            (folder / MODEL).write_text("half")
        long_ago = time.time() - LITTER_SECONDS - 1
        os.utime(old, (long_ago, long_ago))
        store.prune(5)
        assert not old.exists()
        assert new.exists()
        assert steps_of(store) == [1]

    def test_two_executions_may_prune_at_once(self, store: SaveStore) -> None:
        names = [save(store, steps) for steps in range(4)]
        store.delete(names[0])
        store.delete(names[0])
        assert store.names() == names[:0:-1]
