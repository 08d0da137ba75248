"""Arrays of ours in a saved model, beside what stock Stable-Baselines3 reads of it. No pickle."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np


def write(path: Path | io.BytesIO, member: str, arrays: Mapping[str, np.ndarray]) -> None:
    """Add them to a saved ZIP, as the file `member`."""
    file = io.BytesIO()
    np.savez(file, **arrays)  # type: ignore[arg-type]
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(member, file.getvalue())


def read(path: Path | io.BytesIO, member: str) -> dict[str, np.ndarray]:
    """Those of a saved ZIP; none where it has no such file."""
    with zipfile.ZipFile(path) as archive:
        if member not in archive.namelist():
            return {}
        file = io.BytesIO(archive.read(member))
    with np.load(file, allow_pickle=False) as arrays:
        return dict(arrays)
