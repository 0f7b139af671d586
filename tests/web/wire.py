"""A visitor without a browser: the page's requests and messages, byte for byte, or as a liar would send them."""

from __future__ import annotations

import http.client
import socket
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any
from urllib.parse import urlsplit

import msgspec
import viser
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.frames import Frame, Opcode
from websockets.sync.client import ClientConnection, connect

PATIENCE_SECONDS = 20.0
STILL_LOOKS = 40

CAMERA = {
    "wxyz": [1, 0, 0, 0],
    "position": [0, 1, 2.5],
    "fov": 1,
    "near": 0.1,
    "far": 100,
    "image_height": 480,
    "image_width": 640,
    "look_at": [0, 0, 0],
    "up_direction": [0, 1, 0],
}


def get(server: Any, path: str = "/", host: str | None = None, **headers: str) -> tuple[int, dict[str, str], str]:
    """Status, headers and text of what is answered to a GET."""
    place = urlsplit(server.address)
    connection = http.client.HTTPConnection(place.hostname, place.port, timeout=PATIENCE_SECONDS)
    try:
        connection.putrequest("GET", path, skip_host=True, skip_accept_encoding=True)
        for name, value in {"Host": host or place.netloc, **headers}.items():
            connection.putheader(name, value)
        connection.endheaders()
        response = connection.getresponse()
        return response.status, dict(response.headers), response.read().decode(errors="replace")
    finally:
        connection.close()


@contextmanager
def visitor(
    server: Any, query: str = "", version: str = viser.__version__, greet: bool = True, **settings: Any
) -> Iterator[ClientConnection]:
    """A page that is open: it has said where its camera is, and viser takes it for a visitor."""
    place = urlsplit(server.address)
    settings = {"subprotocols": [f"viser-v{version}"], "open_timeout": PATIENCE_SECONDS, "max_size": None, **settings}
    with connect(f"ws://{place.netloc}/{query}", **settings) as connection:
        if greet:
            say(connection, "ViewerCameraMessage", **CAMERA)
        yield connection


class Deaf:
    """A visitor who speaks and never reads, not even that they should go."""

    def __init__(self, server: Any) -> None:
        place = urlsplit(server.address)
        self._socket = socket.socket()
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)  # what is not read piles up at the server
        self._socket.connect((place.hostname, place.port))
        handshake = (
            "GET / HTTP/1.1",
            f"Host: {place.netloc}",
            "Connection: Upgrade",
            "Upgrade: websocket",
            f"Sec-WebSocket-Key: {'A' * 22}==",
            "Sec-WebSocket-Version: 13",
            f"Sec-WebSocket-Protocol: viser-v{viser.__version__}",
            "",
            "",
        )
        self._socket.sendall("\r\n".join(handshake).encode())
        assert b"101 Switching" in self._socket.recv(100)
        say(self, "ViewerCameraMessage", **CAMERA)

    def send(self, content: bytes) -> None:
        self._socket.sendall(Frame(Opcode.BINARY, content).serialize(mask=True))

    def __enter__(self) -> Deaf:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()


def say(connection: ClientConnection | Deaf, kind: str, **fields: Any) -> None:
    """Send a message as the page does."""
    connection.send(msgspec.msgpack.encode({"type": kind, **fields}))


def hear(connection: ClientConnection, kind: str, wanted: Callable[[dict], bool] = lambda message: True) -> dict:
    """The next message of a kind that is wanted; fails if none comes."""
    end = time.monotonic() + PATIENCE_SECONDS
    unheard = connection.__dict__.setdefault("unheard", deque())  # several come in one piece
    while True:
        while unheard:
            message = unheard.popleft()
            if message["type"] == kind and wanted(message):
                return message
        raw = connection.recv(timeout=max(0.0, end - time.monotonic()))
        size, packed = (int.from_bytes(raw[i : i + 8], "little") for i in (0, 8))
        text = zstandard.ZstdDecompressor().decompress(raw[16 : 16 + packed], max_output_size=size)
        unheard.extend(msgspec.msgpack.decode(text)["messages"])


def hear_the_end(connection: ClientConnection) -> int:
    """Code with which the connection is closed."""
    with suppress(ConnectionClosed):
        while True:
            connection.recv(timeout=PATIENCE_SECONDS)
    return connection.protocol.close_code


def wait_until(true: Callable[[], Any]) -> None:
    """Wait until something is true; fails if it takes too long."""
    end = time.monotonic() + PATIENCE_SECONDS
    while not true():
        assert time.monotonic() < end, "it did not come about"
        time.sleep(0.01)


def wait_until_still(value: Callable[[], int]) -> None:
    """Wait until a number changes no more; fails if it goes on."""
    seen: list[int] = []

    def still() -> bool:
        seen.append(value())
        return len(seen) > STILL_LOOKS and len(set(seen[-STILL_LOOKS:])) == 1

    wait_until(still)
