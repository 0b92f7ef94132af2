"""Who may open the page."""

from __future__ import annotations

import asyncio
import os
from typing import Any

import pytest

from glsim.tune import gate as gate_file
from glsim.tune.gate import Gate

HOST = (b"host", b"127.0.0.1:8137")


def answer(
    query: bytes = b"",
    *headers: tuple[bytes, bytes],
    kind: str = "http",
    host: tuple[bytes, bytes] = HOST,
    served: str = "127.0.0.1",
    client: tuple[str, int] | None = None,
    twice: bool = False,
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

    scope = {"type": kind, "query_string": query, "headers": [host, *headers], "client": client}
    tickets = ["right"]

    def use(ticket: str) -> bool:
        return ticket in tickets and tickets.pop() == ticket

    gate = Gate(app, use, "secret", "tune", served, 8137)
    asyncio.run(gate(scope, receive, send))
    if twice:
        asyncio.run(gate(scope, receive, send))
    return sent


def test_a_ticket_lets_in_once_and_leads_to_the_page_with_a_cookie() -> None:
    first, body, again, _ = answer(b"ticket=right&s=abc_-1", twice=True)
    assert (first["status"], again["status"]) == (200, 403)
    headers = dict(first["headers"])
    cookie = headers[b"set-cookie"]
    assert cookie == b"tune=secret; Path=/; HttpOnly; SameSite=Strict; Max-Age=2592000"
    assert b'location.replace("/?s=abc_-1")' in body["body"]
    assert b"ticket" not in body["body"]


def test_what_is_no_link_is_not_written_into_the_page() -> None:
    _, body = answer(b"ticket=right&s=%22)%3Balert(1)%2F%2F")
    assert b'location.replace("/")' in body["body"]


def test_the_cookie_lets_in_pages_and_sockets_and_no_page_may_frame_them() -> None:
    cookie = (b"cookie", b"other=1; tune=secret")
    (start,) = answer(b"", cookie)
    assert start["status"] == 200
    headers = dict(start["headers"])
    assert b"frame-ancestors 'none'" in headers[b"content-security-policy"]
    assert b"set-cookie" not in headers
    assert answer(b"", cookie, kind="websocket")[0]["type"] == "websocket.accept"


COOKIE = (b"cookie", b"tune=secret")


@pytest.mark.parametrize(
    ("query", "headers"),
    [
        (b"", ()),
        (b"ticket=wrong", ()),
        (b"ticket=", ((b"cookie", b"tune=wrong"),)),
        (b"ticket=right%00", ()),
        (b"", (COOKIE, (b"origin", b"http://127.0.0.1:9999"))),
        (b"ticket=right", ((b"origin", b"https://elsewhere.example"),)),
        (b"", ((b"cookie", b"tune=\xe9"),)),
    ],
)
def test_others_are_refused(query: bytes, headers: tuple[tuple[bytes, bytes], ...]) -> None:
    assert answer(query, *headers)[0]["status"] == 403
    closed = answer(query, *headers, kind="websocket")
    assert closed == [{"type": "websocket.close", "code": 1008}]


def test_a_ticket_opens_no_socket() -> None:
    assert answer(b"ticket=right", kind="websocket")[0]["type"] == "websocket.close"


def test_the_page_itself_is_no_foreign_origin() -> None:
    own = (b"origin", b"http://127.0.0.1:8137")
    assert answer(b"", COOKIE, own)[0]["status"] == 200


@pytest.mark.parametrize(
    ("served", "host", "status"),
    [
        ("127.0.0.1", b"localhost:9000", 200),  # through ssh -L
        ("127.0.0.1", b"[::1]:8137", 200),
        ("127.0.0.1", b"evil.example:8137", 403),  # a name that leads to 127.0.0.1
        ("127.0.0.1", b"", 403),
        ("lab.example", b"lab.example:8137", 200),
        ("lab.example", b"evil.example", 403),
        ("0.0.0.0", b"anything.example:8137", 200),
    ],
)
def test_the_name_in_the_address_counts(served: str, host: bytes, status: int) -> None:
    assert answer(b"", COOKIE, host=(b"host", host), served=served)[0]["status"] == status


def test_another_user_of_the_machine_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the right cookie too: a browser sends it to every port of the machine."""
    for uid, status in ((os.getuid(), 200), (0, 200), (54321, 403), (None, 200)):
        monkeypatch.setattr(gate_file, "peer_uid", lambda *_, uid=uid: uid)
        assert answer(b"", COOKIE)[0]["status"] == status
