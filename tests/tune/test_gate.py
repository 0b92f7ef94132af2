"""Who may open the page."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from glsim.tune.gate import Gate

HOST = (b"host", b"127.0.0.1:8137")


def answer(
    query: bytes = b"", *headers: tuple[bytes, bytes], kind: str = "http"
) -> list[dict[str, Any]]:
    sent: list[Any] = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] == "websocket":
            await send({"type": "websocket.accept"})
            return
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def receive() -> Any:
        return {"type": "http.request"}

    async def send(message: Any) -> None:
        sent.append(message)

    scope = {"type": kind, "query_string": query, "headers": [HOST, *headers]}
    asyncio.run(Gate(app, "right", "tune")(scope, receive, send))
    return sent


def test_the_address_lets_in_and_leaves_a_cookie() -> None:
    (start,) = answer(b"token=right&s=abc")
    assert start["status"] == 200
    (header,) = start["headers"]
    assert header == (b"set-cookie", b"tune=right; Path=/; HttpOnly; SameSite=Strict")


def test_the_cookie_lets_in_pages_and_sockets() -> None:
    cookie = (b"cookie", b"other=1; tune=right")
    assert answer(b"", cookie)[0]["status"] == 200
    assert answer(b"", cookie)[0]["headers"] == []
    assert answer(b"", cookie, kind="websocket")[0]["type"] == "websocket.accept"


@pytest.mark.parametrize(
    ("query", "headers"),
    [
        (b"", ()),
        (b"token=wrong", ()),
        (b"token=", ((b"cookie", b"tune=wrong"),)),
        (b"token=right%00", ()),
        (b"", ((b"cookie", b"tune=right"), (b"origin", b"http://127.0.0.1:9999"))),
        (b"token=right", ((b"origin", b"https://elsewhere.example"),)),
    ],
)
def test_others_are_refused(query: bytes, headers: tuple[tuple[bytes, bytes], ...]) -> None:
    assert answer(query, *headers)[0]["status"] == 403
    closed = answer(query, *headers, kind="websocket")
    assert closed == [{"type": "websocket.close", "code": 1008}]


def test_the_page_itself_is_no_foreign_origin() -> None:
    own = (b"origin", b"http://127.0.0.1:8137")
    assert answer(b"", (b"cookie", b"tune=right"), own)[0]["status"] == 200
