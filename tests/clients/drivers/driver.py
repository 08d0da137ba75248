"""The Python client, driven by JSON lines on standard input (tests/clients/driving.py). `--plain`: without orjson."""

from __future__ import annotations

import json
import sys
from typing import Any

if "--plain" in sys.argv:
    sys.modules["orjson"] = None  # type: ignore[assignment]

import numpy as np
from shepherd_client import Client, ShepherdError, TransientError, encoding

assert (encoding.orjson is None) == ("--plain" in sys.argv)


class Driver:
    """One session."""

    session: Any = None

    def login(self, key: str, url: str, patience: float) -> Any:
        self.session = Client(key, url, patience=patience).session()
        return self.state()

    def resume(self, key: str, url: str, patience: float, session: str, seq: int) -> Any:
        self.session = Client(key, url, patience=patience).resume(session, seq)
        return self.state()

    def state(self) -> Any:
        return {"key": self.session.key, "seq": self.session.seq, "agent": self.session.agent or None}

    def step(self, obs: Any, dtype: str = "", **options: Any) -> Any:
        return self.session.step(_array(obs, dtype), **options)._asdict()

    def act(self, obs: Any) -> Any:
        return self.session.act(obs)

    def observe(self, obs: Any, reward: float, **options: Any) -> Any:
        return self.session.observe(obs, reward, **options)

    def close(self) -> Any:
        if self.session is not None:
            self.session.close()


def _array(obs: Any, dtype: str) -> Any:
    if isinstance(obs, dict):
        return {key: _array(value, dtype) for key, value in obs.items()}
    return np.array(obs, dtype) if dtype else obs


def _answer(driver: Driver, line: str) -> Any:
    request = json.loads(line)
    try:
        return {"result": getattr(driver, request.pop("op"))(**request)}
    except ShepherdError as error:
        return {
            "error": {
                "type": type(error).__name__,
                "code": error.code,
                "status": error.status,
                "retry_after": error.retry_after,
                "message": str(error),
                "transient": isinstance(error, TransientError),
            }
        }


if __name__ == "__main__":
    one = Driver()
    for line in sys.stdin:
        sys.stdout.write(json.dumps(_answer(one, line)) + "\n")
        sys.stdout.flush()
