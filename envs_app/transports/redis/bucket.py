"""The CPU quota of an agent, which all its executions share."""

from __future__ import annotations

import msgpack

from envs_app.transports.quota import Bucket
from envs_app.transports.redis import keys, scripts
from envs_app.transports.redis.shared import TRIES, seconds
from envs_app.transports.redis.wire import Wire


def pay(wire: Wire, name: str, percent: float, used: float) -> float:
    """Take CPU seconds from a bucket that several processes share; returns for how many seconds to pause."""
    for _ in range(TRIES):
        time_, raw = wire.ask(("TIME",), ("GET", name))
        now, bucket = seconds(time_), Bucket(percent)
        at = now
        if raw:
            bucket.level, at = msgpack.unpackb(raw)
        pause = bucket.use(used, max(0.0, now - at))
        new = msgpack.packb((bucket.level, now))
        lifetimes = keys.ms(keys.AGENT), 0
        if wire.ask(scripts.script(scripts.COMMIT, [name], raw or b"", new, *lifetimes))[0]:
            return pause
    return 0.0  # so many pay at once that the next second will do
