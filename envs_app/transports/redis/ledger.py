"""The ledger in Redis: where each session stands, kept with the answer that it led to.

The execution that owns a session also holds its state in memory. So a step reads nothing, a Redis that lost its memory is told
the state again, and an answer that could not be sent is given when it is asked for again. Ownership has a generation, which
grows with each change: whoever is late (a process that hung, a Redis that woke up with yesterday's memory) cannot write.
"""

from __future__ import annotations

from typing import Any

import msgpack

from envs_app.execution.ledger import FIELDS, SessionState
from envs_app.messages import Message
from envs_app.transports.redis import keys, scripts
from envs_app.transports.redis.wire import Command, Wire

HELD = 10_000  # states in memory


class RedisLedger:
    """The states of an execution's sessions (execution.ledger.Ledger)."""

    def __init__(self, wire: Wire, uid: str, lifetime: float) -> None:
        """`lifetime`: seconds that the state of a silent session is kept."""
        self.wire, self.uid, self.lifetime = wire, uid, lifetime
        self._held: dict[int, SessionState] = {}
        self._generations: dict[int, int] = {}
        self._unsent: set[int] = set()

    def load(self, session: int) -> SessionState:
        """What is held, or else what Redis has; a blank state for a session that never stepped. Raises Unreachable."""
        if session in self._held:
            return self._held[session]
        owner, generation, raw = self._read(session)
        while len(self._generations) > 2 * HELD:
            self._generations.pop(next(iter(self._generations)))
        self._generations.pop(session, None)
        self._generations[session] = generation + (owner != self.uid)
        return SessionState(**msgpack.unpackb(raw)) if raw else SessionState()

    def store(self, session: int, state: SessionState) -> None:
        """Hold the state; Redis gets it with the answer."""
        if len(self._held) >= HELD:
            self.close(next(iter(self._held)))
        self._held[session] = state
        self._unsent.add(session)

    def close(self, session: int) -> None:
        """Hold it no longer."""
        self._held.pop(session, None)
        self._unsent.discard(session)

    def holds(self, session: int) -> bool:
        """Whether it is served here."""
        return session in self._held

    def was_taken(self, session: int) -> bool:
        """Whether somebody else has had the session since it was held here. Raises Unreachable."""
        return session in self._held and self._read(session)[1] > self._generations[session]

    def send(self, session: int, reply: str, message: Message) -> bool:
        """Answer, and keep the state if it is not kept yet; False: somebody else has the session. Raises Unreachable."""
        packed = msgpack.packb(message)
        if session not in self._unsent:
            self.wire.ask(
                ("RPUSH", reply, packed),
                ("PEXPIRE", reply, keys.ms(keys.REPLY)),
                ("SREM", keys.pending(self.uid), reply),
            )
            return True
        refusal = msgpack.packb({"k": "error", "code": "not_mine", "detail": "", "retry_after": None})
        names = [keys.ledger(session), reply, keys.pending(self.uid)]
        arguments = *self._state(session), packed, refusal, keys.ms(keys.REPLY)
        [mine] = self.wire.ask(scripts.script(scripts.ANSWER, names, *arguments))
        self._unsent.discard(session)
        return bool(mine)

    def restore(self) -> list[int]:
        """Tell Redis all that is held; the sessions that somebody else has by now. Raises Unreachable."""
        held = list(self._held)
        commands: list[Command] = [
            scripts.script(scripts.KEEP, [keys.ledger(session)], *self._state(session)) for session in held
        ]
        mine = self.wire.ask(*commands) if commands else []
        return [session for session, is_mine in zip(held, mine, strict=True) if not is_mine]

    def _state(self, session: int) -> tuple[Any, ...]:
        state = self._held[session]
        packed = msgpack.packb({name: getattr(state, name) for name in FIELDS})
        return self.uid, self._generations[session], packed, keys.ms(self.lifetime)

    def _read(self, session: int) -> tuple[str, int, bytes]:
        """Owner, generation and state."""
        [(owner, generation, raw)] = self.wire.ask(("HMGET", keys.ledger(session), "owner", "generation", "state"))
        return (owner or b"").decode(), int(generation or 0), raw or b""
