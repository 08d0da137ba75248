"""What travels between a web process, the parent and an execution: dictionaries in MessagePack, framed by their length.

Observations travel as the raw bytes of their arrays; both ends know the space.
"""

from __future__ import annotations

import socket
import struct
from typing import Any

import msgpack
import numpy as np
from gymnasium import spaces

LENGTH = struct.Struct("!I")
MAX_FRAME = 256 * 2**20
CHUNK = 2**14  # bytes read at once; a larger buffer would be mapped and unmapped for every small frame

Message = dict[str, Any]


def pack(message: Message) -> bytes:
    """One frame: 4 bytes of length, then the message."""
    body = msgpack.packb(message)
    return LENGTH.pack(len(body)) + body


def unpack(body: bytes) -> Message:
    """The message of a frame's body. Raises ConnectionError when it is none: the sender is no part of Shepherd."""
    try:
        message = msgpack.unpackb(body, strict_map_key=False)
    except ValueError as error:
        raise ConnectionError(f"no message: {error}") from error
    if not isinstance(message, dict) or not isinstance(message.get("k"), str):
        raise ConnectionError("no message: a dictionary with its kind 'k' is expected")
    return message


def receive(connection: socket.socket) -> Message:
    """Wait for one frame. Raises ConnectionError when the other end closes, TimeoutError or BlockingIOError when it is late."""
    data = connection.recv(CHUNK)  # nearly always all of it
    while len(data) < LENGTH.size or len(data) < LENGTH.size + _length(data):
        chunk = connection.recv(CHUNK if len(data) < CHUNK else 2**20)
        if not chunk:
            raise ConnectionError("the other end closed the connection")
        data += chunk
    return unpack(data[LENGTH.size :])


def _length(data: bytes | bytearray) -> int:
    (length,) = LENGTH.unpack_from(data)
    if length > MAX_FRAME:
        raise ConnectionError(f"a frame of {length} bytes")
    return length


class FrameReader:
    """Collects frames from a socket that does not block."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Message]:
        """The messages that are whole now. Raises ConnectionError for a frame that is too long, or no message."""
        if not self._buffer and len(data) >= LENGTH.size and len(data) == LENGTH.size + _length(data):
            return [unpack(data[LENGTH.size :])]  # nearly always: one whole frame
        self._buffer += data
        messages = []
        while len(self._buffer) >= LENGTH.size:
            end = LENGTH.size + _length(self._buffer)
            if len(self._buffer) < end:
                break
            messages.append(unpack(bytes(self._buffer[LENGTH.size : end])))
            del self._buffer[:end]
        return messages


def encode_observation(obs: Any) -> Any:
    """An observation for a message: an int, the bytes of an array, or a dictionary of those."""
    if isinstance(obs, dict):
        return {key: encode_observation(value) for key, value in obs.items()}
    return obs.tobytes() if isinstance(obs, np.ndarray) else int(obs)


def decode_advice(data: bytes | None) -> np.ndarray | None:
    """A client's advice again."""
    return None if data is None else np.frombuffer(data, np.float32)


def decode_observation(space: spaces.Space, data: Any) -> Any:
    """The observation again, of its space."""
    if isinstance(space, spaces.Dict):
        return {key: decode_observation(sub, data[key]) for key, sub in space.spaces.items()}
    if isinstance(space, spaces.Box):
        return np.frombuffer(data, space.dtype).reshape(space.shape)
    return np.int64(data)
