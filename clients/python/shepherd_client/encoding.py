"""JSON for observations: plain Python values, NumPy arrays and scalars, and whatever else has a `tolist()`."""

from __future__ import annotations

import json
from typing import Any

try:
    import orjson
except ImportError:
    orjson = None  # type: ignore[assignment]


def encode(value: Any) -> bytes:
    """The JSON of a value; with orjson installed, arrays are written without a detour over lists."""
    if orjson is not None:
        return orjson.dumps(value, default=_plain, option=orjson.OPT_SERIALIZE_NUMPY)
    return json.dumps(value, default=_plain, separators=(",", ":")).encode()


def decode(text: bytes) -> Any:
    """The value of a JSON text. Raises ValueError if it is none."""
    return json.loads(text) if orjson is None else orjson.loads(text)


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be sent: use numbers, lists, arrays, texts and dictionaries.")
