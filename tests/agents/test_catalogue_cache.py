"""What signatures say is read once for the same code, and read anew wherever it cannot be kept."""

from __future__ import annotations

from pathlib import Path

import pytest

from agents_app import catalogue_cache
from agents_app.catalogue_cache import Read, cached

ENTRIES: Read = {"PPO": [{"name": "gamma", "default": 0.99}]}


def test_it_is_read_once(tmp_path: Path) -> None:
    assert cached(lambda: ENTRIES, tmp_path / "kept") == ENTRIES
    assert cached(lambda: pytest.fail("it was read again"), tmp_path / "kept") == ENTRIES


def test_other_code_is_read_anew_and_the_old_is_forgotten(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cached(lambda: {}, tmp_path)
    monkeypatch.setattr(catalogue_cache, "fingerprint", lambda: "other")
    assert cached(lambda: ENTRIES, tmp_path) == ENTRIES
    assert [path.name for path in tmp_path.iterdir()] == ["catalogue-other.json"]


def test_a_broken_file_is_replaced(tmp_path: Path) -> None:
    cached(lambda: {}, tmp_path)
    [path] = tmp_path.iterdir()
    path.write_text('{"PPO": [')
    assert cached(lambda: ENTRIES, tmp_path) == ENTRIES
    assert cached(lambda: {}, tmp_path) == ENTRIES


def test_where_nothing_can_be_written_it_is_read_each_time(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for _ in range(2):
        assert cached(lambda: ENTRIES, tmp_path / "file" / "below") == ENTRIES
