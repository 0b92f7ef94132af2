"""Who is at the other end of a connection from this machine."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from glsim.tune import peer
from glsim.tune.peer import peer_uid

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="/proc/net/tcp is Linux'")


@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
def test_our_own_connection_is_ours(host: str) -> None:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        listening = socket.create_server((host, 0), family=family)
    except OSError as error:
        pytest.skip(f"this machine has no {host}: {error}")
    with listening, socket.create_connection(listening.getsockname()[:2]) as client:
        assert peer_uid(client.getsockname(), listening.getsockname()[1]) == os.getuid()
        assert peer_uid(client.getsockname(), 1) is None
    assert peer_uid(None, 80) is None
    assert peer_uid(("192.0.2.7", 4711), 80) is None
    assert peer_uid(("a socket of Unix", 0), 80) is None


@pytest.mark.skipif(os.getuid() != 0, reason="only root can connect as another user")
def test_the_connection_of_another_user_is_theirs() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        listening.settimeout(30)
        port = listening.getsockname()[1]
        connect = f"s = socket.create_connection(('127.0.0.1', {port})); s.recv(1)"
        program = f"import encodings.idna, os, socket; os.setuid(65534); {connect}"
        other = subprocess.Popen([sys.executable, "-c", program])
        served, client = listening.accept()
        with served:
            assert peer_uid(client, port) == 65534
            served.send(b"x")
        assert other.wait(30) == 0


def test_a_version_4_address_within_version_6_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    line = (
        "   0: 0000000000000000FFFF00000100007F:1F90 0000000000000000FFFF00000100007F:1FC9 01 "
        "00000000:00000000 00:00000000 00000000  1234        0 99 1 0 20 4 30 10 -1\n"
    )
    (tmp_path / "tcp6").write_text("header\n" + line)
    monkeypatch.setattr(peer, "_TABLES", (tmp_path / "missing", tmp_path / "tcp6"))
    if sys.byteorder == "little":
        assert peer_uid(("127.0.0.1", 0x1F90), 0x1FC9) == 1234
