"""The policies of a run's executions, which travel through Redis."""

from __future__ import annotations

import numpy as np

from envs_app.transports.redis import keys
from envs_app.transports.redis.shared import said_by
from envs_app.transports.redis.wire import Unreachable, Wire


class RedisPeers:
    """The policies that the run's other executions published."""

    def __init__(self, wire: Wire, run: int, number: int) -> None:
        self._wire, self._run, self._number = wire, run, number
        self._known: dict[int, tuple[str, int, float | None]] = {}  # uid, version, mean return

    def read(self, raw: list[bytes], now: float) -> None:
        """Take over the hash `peers` of the run."""
        said = said_by(raw)
        live = {int(number): facts for number, (at, facts) in said.items() if now - at <= keys.LEASE}
        live.pop(self._number, None)
        self._known = {number: (facts["uid"], facts["version"], facts["mean"]) for number, facts in live.items()}

    def uids(self) -> list[str]:
        """The live peers."""
        return [uid for uid, _, _ in self._known.values()]

    def versions(self) -> dict[int, int]:
        """The live peers that have published."""
        return {number: version for number, (_, version, _) in self._known.items()}

    def mean_returns(self) -> dict[int, float]:
        """Of those that have ended an episode."""
        return {number: mean for number, (_, _, mean) in self._known.items() if mean is not None}

    def weights(self, number: int) -> np.ndarray | None:
        """The latest weights of a peer."""
        try:
            [raw] = self._wire.ask(("GET", keys.weights(self._known[number][0])))
        except (Unreachable, KeyError):
            return None
        return None if raw is None else np.frombuffer(raw, np.float32)
