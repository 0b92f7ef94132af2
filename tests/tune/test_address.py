"""The socket of the tuner's page takes connections before the server is up."""

from __future__ import annotations

import queue
import socket
import webbrowser
from pathlib import Path

import pytest

from glsim.errors import ConfigError
from glsim.tune.address import listen


def test_a_browser_can_connect_before_the_server_is_up() -> None:
    address = listen("127.0.0.1", 0)
    with address.listening, socket.create_connection(("127.0.0.1", address.port), 5) as browser:
        browser.sendall(b"GET /")
        served, _ = address.listening.accept()
        with served:
            assert served.recv(5) == b"GET /"
            assert served.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


def test_a_port_in_use_gives_a_free_one() -> None:
    with listen("127.0.0.1", 0).listening as taken:
        wanted = taken.getsockname()[1]
        other = listen("127.0.0.1", wanted)
        with other.listening:
            assert other.port not in (0, wanted)


def test_a_ticket_is_used_once_and_another_follows() -> None:
    one, other = listen("127.0.0.1", 0), listen("127.0.0.1", 0)
    with one.listening, other.listening:
        first = one.ticket
        assert one.url == f"http://127.0.0.1:{one.port}/?ticket={first}"
        assert first != other.ticket
        assert len(first) >= 32
        assert not one.use(other.ticket)
        assert one.use(first)
        assert not one.use(first)
        assert one.use(one.ticket)


def test_the_browser_is_given_a_private_file_and_no_ticket(monkeypatch: pytest.MonkeyPatch) -> None:
    """Everybody on the machine can read the arguments of the browser's process."""
    opened: queue.Queue[str] = queue.Queue()
    monkeypatch.setattr(webbrowser, "open", opened.put)
    address = listen("127.0.0.1", 0)
    with address.listening:
        address.open_browser()
        given = opened.get(timeout=10)
        assert given.startswith("file://")
        assert address.ticket not in given
        page = Path(given.removeprefix("file://"))
        assert page.stat().st_mode & 0o777 == 0o600
        assert page.parent.stat().st_mode & 0o777 == 0o700
        assert f'location.replace("{address.url}")' in page.read_text()
        address.use(address.ticket)
        assert not page.parent.exists()


def test_an_address_of_version_6_stands_in_brackets() -> None:
    try:
        address = listen("::1", 0)
    except ConfigError as error:
        pytest.skip(f"this machine has no IPv6: {error}")
    with address.listening:
        assert address.url.startswith(f"http://[::1]:{address.port}/?ticket=")


def test_a_machine_without_ipv6_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(family: int) -> None:
        raise OSError(97, "Address family not supported by protocol")

    monkeypatch.setattr(socket, "socket", refuse)
    with pytest.raises(ConfigError, match="--host ::1 --port 8137: Address family not supported"):
        listen("::1", 8137)


def test_a_host_of_another_machine_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"--host 192\.0\.2\.1 --port 8137: "):
        listen("192.0.2.1", 8137)
