"""The client of Shepherd's HTTP API: log in with an API key, send observations and rewards, get actions."""

from __future__ import annotations

import contextlib
from types import TracebackType
from typing import Any, NamedTuple, Self
from weakref import WeakSet

from shepherd_client.connection import Address, Connection
from shepherd_client.errors import TransientError, UnknownSession
from shepherd_client.patience import Patience

DEFAULT_URL = "http://127.0.0.1:8000"
CLOSING_PATIENCE = 5.0  # seconds; a session that is not closed ends by itself later


class Reply(NamedTuple):
    """The answer to a step: an action, or after the end of an episode none and the sum of its rewards."""

    action: Any  # int for Discrete(n), a list of floats for a Box
    seq: int
    episode_return: float | None = None


class Client:
    """Opens sessions with one agent.

    `patience` is how many seconds a request is repeated while the server cannot be reached or asks to wait, `timeout`
    how many seconds one attempt may take.
    """

    def __init__(self, api_key: str, url: str = DEFAULT_URL, *, patience: float = 60.0, timeout: float = 30.0) -> None:
        self._api_key = api_key
        self._address = Address.parse(url)
        self._patience = patience
        self._timeout = timeout
        self._sessions: WeakSet[Session] = WeakSet()

    def session(self) -> Session:
        """Log in. Raises InvalidApiKey, or ConnectionLost when no server answers."""
        connection = self._connect()
        reply = _request(connection, self._patience, "POST", "/api/v1/sessions", self._api_key)
        return self._open(connection, reply["session_key"], 0, reply["agent"])

    def resume(self, key: str, seq: int) -> Session:
        """The session of another process, by its `key` and the `seq` of the last reply that it got."""
        return self._open(self._connect(), key, seq, {})

    def close(self) -> None:
        """Close all sessions that this client opened."""
        for session in list(self._sessions):
            session.close()

    def _connect(self) -> Connection:
        return Connection(self._address, self._timeout)

    def _open(self, connection: Connection, key: str, seq: int, agent: dict[str, Any]) -> Session:
        session = Session(connection, key, seq, agent, self._patience)
        self._sessions.add(session)
        return session

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with contextlib.suppress(TransientError):
            self.close()


class Session:
    """One conversation with an agent, for one environment and one thread.

    Either send every step yourself with `step()`, or let `act()` and `observe()` do the book-keeping.
    """

    def __init__(self, connection: Connection, key: str, seq: int, agent: dict[str, Any], patience: float) -> None:
        self.key = key  # with `seq`, all that Client.resume() needs
        self.seq = seq  # of the last answered step
        self.agent = agent  # name, algorithm, action_space, observation_space; empty when resumed
        self._connection = connection
        self._patience = patience
        self._reward = 0.0  # since the last step, for act() and observe()
        self._closed = False

    def step(
        self,
        obs: Any,
        reward: float = 0.0,
        terminated: bool = False,
        truncated: bool = False,
        info: dict[str, Any] | None = None,
        action_mask: Any = None,
        advice: Any = None,
    ) -> Reply:
        """Send an observation, and the reward of the action before it; get the next action.

        At the end of an episode send its last observation with `terminated` or `truncated`; the reply has no action but
        the episode's return, and the next step begins an episode. Lost connections and requests to wait are repeated
        for as long as the client's patience; the server steps once, however often it was asked. After a TransientError
        repeat the same step; after an Invalid... error mend it.
        """
        payload: dict[str, Any] = {"obs": obs, "reward": reward, "terminated": terminated, "truncated": truncated}
        optional = {"info": info, "action_mask": action_mask, "advice": advice}
        payload |= {name: value for name, value in optional.items() if value is not None}
        payload["seq"] = self.seq + 1
        reply = _request(self._connection, self._patience, "POST", "/api/v1/step", self.key, payload)
        self.seq = reply["seq"]
        return Reply(reply["action"], self.seq, reply.get("episode_return"))

    def act(self, obs: Any, *, info: dict[str, Any] | None = None, action_mask: Any = None, advice: Any = None) -> Any:
        """The action for an observation."""
        reply = self.step(obs, self._reward, info=info, action_mask=action_mask, advice=advice)
        self._reward = 0.0
        return reply.action

    def observe(self, obs: Any, reward: float, terminated: bool = False, truncated: bool = False) -> float | None:
        """What came of the action: kept for the next act(); at an episode's end sent, and the return comes back.

        Several rewards between two actions are added.
        """
        total = self._reward + float(reward)
        if not (terminated or truncated):
            self._reward = total
            return None
        reply = self.step(obs, total, terminated, truncated)
        self._reward = 0.0  # only now: after an error the same call may be repeated
        return reply.episode_return

    def close(self) -> None:
        """End the session. Doing so twice does no harm."""
        if self._closed:
            return
        self._closed = True
        try:
            with contextlib.suppress(UnknownSession):
                _request(self._connection, min(self._patience, CLOSING_PATIENCE), "DELETE", "/api/v1/session", self.key)
        finally:
            self._connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with contextlib.suppress(TransientError):
            self.close()


def _request(
    connection: Connection, patience: float, method: str, path: str, key: str, payload: Any = None
) -> dict[str, Any]:
    """The reply, after as many attempts as the patience allows. The `seq` in a step makes repeating it harmless."""
    waiting = Patience(patience)
    while True:
        try:
            return connection.request(method, path, key, payload)
        except TransientError as error:
            waiting.wait(error)
