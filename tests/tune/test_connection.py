"""A client that is slow to ask is dropped; one that waits for an answer is not."""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("uvicorn", reason="the extra glsim[tune] is not installed")

import uvicorn

from glsim.tune import connection
from glsim.tune.connection import TimedConnection

HEAD = b"GET / HTTP/1.1\r\nHost: x\r\n"


async def slow_app(scope: Any, receive: Any, send: Any) -> None:
    """Answer after a second, and leave the body unread."""
    if scope["type"] != "http":
        return
    if scope["method"] == "GET":
        await asyncio.sleep(1)
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"done"})


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    monkeypatch.setattr(connection, "REQUEST_S", 0.4)
    listening = socket.create_server(("127.0.0.1", 0))
    config = uvicorn.Config(
        slow_app, http=TimedConnection, lifespan="off", log_level="error", timeout_keep_alive=20
    )
    server = uvicorn.Server(config)
    running = threading.Thread(target=server.run, args=([listening],), daemon=True)
    running.start()
    yield int(listening.getsockname()[1])
    server.should_exit = True
    running.join(30)


def lasts_s(port: int, start: bytes, drip: bytes) -> float:
    """How long a client that sends a byte each tenth of a second is kept."""
    begin = time.monotonic()
    with socket.create_connection(("127.0.0.1", port), timeout=5) as client:
        client.sendall(start)
        while time.monotonic() - begin < 5:
            try:
                if drip:
                    client.sendall(drip)
                client.settimeout(0.1)
                if not client.recv(1000):
                    break
            except TimeoutError:
                continue
            except OSError:
                break
    return time.monotonic() - begin


@pytest.mark.parametrize(
    ("start", "drip"),
    [
        (b"", b""),
        (HEAD + b"X: ", b"a"),
        (b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 9999\r\n\r\n", b"a"),
    ],
)
def test_a_slow_client_is_dropped(port: int, start: bytes, drip: bytes) -> None:
    assert lasts_s(port, start, drip) < 3


def test_a_client_that_waits_is_answered_again_and_again(port: int) -> None:
    """Answers take longer than a request may; the pause between two requests is another limit."""
    with socket.create_connection(("127.0.0.1", port), timeout=20) as client:
        for _ in range(2):
            client.sendall(HEAD + b"\r\n")
            answer = b""
            while b"done" not in answer:
                part = client.recv(1000)
                assert part, answer
                answer += part
            time.sleep(0.8)
