"""Whatever is sent to the server's port or to its sockets: a clear answer or a closed connection, and all goes on."""

from __future__ import annotations

import json
import random
import socket
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from typing import Any
from urllib.parse import urlsplit

import httpx
import msgpack
import pytest
from shepherd_client import Client, Session

from tests.faults.inside import HERE, executions_of
from tests.faults.players import playing
from tests.servers import Server

Agent = Callable[[str], tuple[str, str]]
STEP = {"obs": HERE, "reward": 1.0, "terminated": False, "truncated": False}

BAD_STEPS: dict[str, Any] = {
    "too short": STEP | {"obs": [0.0]},
    "too deep": STEP | {"obs": [[0.0, 0.0, 0.0, 0.0]]},
    "no list": STEP | {"obs": {"x": 1}},
    "null": STEP | {"obs": None},
    "texts": STEP | {"obs": ["a", "b", "c", "d"]},
    "reward of text": STEP | {"reward": "1"},
    "reward of a list": STEP | {"reward": [1.0]},
    "terminated by number": STEP | {"terminated": 1},
    "negative seq": STEP | {"seq": -1},
    "seq of text": STEP | {"seq": "1"},
    "gap": STEP | {"seq": 10**9},
    "mask of nobody": STEP | {"action_mask": [True, False]},
    "a large info": STEP | {"info": {"x": "x" * 70_000}},
    "a deep info": STEP | {"info": json.loads('{"x":' * 900 + "1" + "}" * 900)},
    "info of a list": STEP | {"info": []},
    "a list": [STEP],
    "a number": 7,
}
BAD_BODIES: dict[str, bytes] = {
    "NaN": b'{"obs": [NaN, 0, 0, 0], "reward": 1.0}',
    "NaN reward": b'{"obs": [0, 0, 0, 0], "reward": NaN}',
    "infinity": b'{"obs": [1e999, 0, 0, 0], "reward": 1.0}',
    "huge integer": b'{"obs": [' + b"9" * 400 + b', 0, 0, 0], "reward": 1.0}',
    "cut off": b'{"obs": [0, 0, 0',
    "nothing": b"",
    "no text": b"\xff\xfe\x00\x80" * 50,
    "nested deeply": b"[" * 100_000,
    "huge": b'{"obs": [' + b"0," * 5_000_000 + b"0]}",
}


@pytest.fixture
def session(own: Server, agent: Agent) -> Iterator[Session]:
    """A session in the middle of an episode, of which each test must leave 10 good steps and nothing else."""
    with Client(agent("other")[1], own.url) as client:
        session = client.session()
        session.step(HERE)
        for _ in range(4):
            session.step(HERE, 1.0)
        yield session
        for _ in range(5):
            session.step(HERE, 1.0)
        assert session.step(HERE, 1.0, terminated=True).episode_return == 10.0


def connect(server: Server) -> socket.socket:
    """A connection to the server's port."""
    address = urlsplit(server.url)
    assert address.hostname
    return socket.create_connection((address.hostname, address.port), timeout=30)


def head(key: str, length: int) -> bytes:
    """The head of a step's request."""
    lines = ["POST /api/v1/step HTTP/1.1", "Host: test", f"Authorization: Bearer {key}", f"Content-Length: {length}"]
    return "\r\n".join([*lines, "Content-Type: application/json", "", ""]).encode()


def test_bad_requests_are_refused_and_leave_no_trace(own: Server, session: Session) -> None:
    bodies = {name: json.dumps(step).encode() for name, step in BAD_STEPS.items()} | BAD_BODIES
    headers = {"Authorization": f"Bearer {session.key}", "Content-Type": "application/json"}
    with httpx.Client(base_url=own.url, headers=headers, timeout=30) as http:
        for name, body in bodies.items():
            answer = http.post("api/v1/step", content=body)
            expected = {"huge": (413,), "gap": (409,)}.get(name, (422,))
            assert answer.status_code in expected, (name, answer.text)
            assert answer.headers["content-type"] == "application/problem+json", name
            assert answer.json()["detail"], name


def test_noise_on_the_port_harms_nobody(own: Server, session: Session) -> None:
    noise = random.Random(1)
    for size in (1, 10, 1000, 100_000):
        with connect(own) as connection, suppress(OSError):
            connection.sendall(noise.randbytes(size))
            connection.shutdown(socket.SHUT_WR)
            connection.recv(1000)


def nonsense() -> Iterator[bytes]:
    """What nobody should send to a Unix socket: noise, broken frames, and messages that mean nothing."""
    noise = random.Random(2)
    yield from (noise.randbytes(noise.randrange(1, 2000)) for _ in range(100))
    yield b"GET / HTTP/1.1\r\n\r\n"
    yield b"\xff" * 4
    messages: list[Any] = [None, [], "step", {}, {"k": 1}, {"k": "nothing"}, {"k": "_fork"}, {"k": "step"}]
    messages += [
        {"k": kind} for kind in ("acquire", "launch", "forget", "status", "configure", "stop", "save", "events")
    ]
    messages += [{"k": "launch", "claim": {"agent": 1}, "spec": {}, "exclude": 7}, {"k": "step", "session": {}}]
    for message in messages:
        body = msgpack.packb(message)
        yield struct.pack("!I", len(body)) + body


def test_noise_on_the_sockets_of_parent_and_execution_kills_neither(
    own: Server, agent: Agent, session: Session
) -> None:
    before = own.parent_pid(), {execution["pid"] for execution in executions_of(own, agent("other")[0])}
    for path in (own.data / "run").glob("*.sock"):
        for data in nonsense():
            with socket.socket(socket.AF_UNIX) as connection, suppress(OSError):
                connection.settimeout(5)
                connection.connect(str(path))
                connection.sendall(data)
                connection.shutdown(socket.SHUT_WR)
                connection.recv(1000)
    assert before == (own.parent_pid(), {execution["pid"] for execution in executions_of(own, agent("other")[0])})


def test_slow_clients_hold_up_nobody_else(own: Server, session: Session) -> None:
    """A hundred of them, more than the web processes have threads, send a byte a second."""
    body = json.dumps(STEP).encode()
    with ExitStack() as stack:
        slow = [stack.enter_context(connect(own)) for _ in range(100)]
        for connection in slow:
            connection.sendall(head(session.key, len(body)))
        for second in range(3):
            for connection in slow:
                connection.sendall(body[second : second + 1])
            time.sleep(1)
            assert httpx.get(f"{own.url}healthz", timeout=10).status_code == 200
            session.seq -= 1
            assert session.step(HERE, 1.0).action in (0, 1)


def test_a_slow_client_is_answered_in_the_end(own: Server, session: Session) -> None:
    body = json.dumps(STEP | {"seq": session.seq}).encode()  # a retry: it leaves no trace
    with connect(own) as connection:
        for byte in head(session.key, len(body)) + body:
            connection.sendall(bytes([byte]))
            time.sleep(0.01)
        assert connection.recv(1000).startswith(b"HTTP/1.1 200")


def test_clients_that_leave_in_the_middle_of_a_reply_harm_nobody(own: Server, agent: Agent, session: Session) -> None:
    body = json.dumps(STEP | {"seq": session.seq}).encode()
    for _ in range(100):
        connection = connect(own)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # close() resets
        connection.sendall(head(session.key, len(body)) + body)
        connection.close()


def test_three_hundred_idle_sessions_cost_nobody_a_place(own: Server, agent: Agent) -> None:
    with httpx.Client(base_url=own.url, headers={"Authorization": f"Bearer {agent('crowded')[1]}"}, timeout=30) as http:
        for _ in range(300):
            assert http.post("api/v1/sessions").status_code == 201
    assert len(executions_of(own, agent("crowded")[0])) == 4
    with playing(own, agent("crowded")[1]) as players:
        players.play_on()
