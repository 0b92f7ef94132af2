"""Abuse the server of glsim tune: python -m benchmarks.stress tuner [--forms TEXT].

Clients of this machine's own user that are slow, many, large, malformed or foreign, against one
server without a browser. After each form the user's own browser, played by one client with the
cookie, must be answered: of slow and silent clients while they still hold their connections, since
the server drops them. The server may take 600 MB, and must end within 2 s of SIGTERM, with 90
connections open. Linux only. Needs the extra glsim[tune].
"""

from __future__ import annotations

import argparse
import contextlib
import http.client
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

_MEMORY_MB = 600
_TERM_S = 2.0
_CLIENTS = 150
_LARGE = 10_000_000
#: How long slow clients may keep the user out, seconds: the server's limit, and some for a busy
#: machine. And how long the start may take.
_PATIENCE_S, _START_S = 30.0, 180.0
_SENSOR = """title = "small"
[rig]
width = 96
height = 80
focal_px = [80, 80]
centre_px = [48, 40]
[[stage]]
use = "axial"
"""
_SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"


@dataclass
class Server:
    """A running server, and the cookie of the user's browser."""

    process: subprocess.Popen[bytes]
    port: int
    cookie: str
    open: list[socket.socket] = field(default_factory=list)

    def connect(self) -> socket.socket:
        """Open a connection that ``close`` closes."""
        connection = socket.create_connection(("127.0.0.1", self.port), timeout=_PATIENCE_S)
        self.open.append(connection)
        return connection

    def close(self) -> None:
        """Close the connections of a form."""
        for connection in self.open:
            connection.close()
        self.open.clear()

    def status(self) -> int:
        """Return the status that the user's browser gets for a file of the page; 0: none."""
        client = http.client.HTTPConnection("127.0.0.1", self.port, timeout=5)
        try:
            client.request("GET", "/tune/other/none", headers={"Cookie": self.cookie})
            return client.getresponse().status
        except (OSError, http.client.HTTPException):
            return 0
        finally:
            client.close()

    def peak_mb(self) -> float:
        """Return the most memory that the server had."""
        text = Path(f"/proc/{self.process.pid}/status").read_text()
        found = re.search(r"VmHWM:\s+(\d+) kB", text)
        return int(found[1]) / 1000 if found else 0.0


def _silent(server: Server) -> str:
    """Connect, and say nothing."""
    for _ in range(_CLIENTS):
        server.connect()
    return ""


def _trickle(server: Server, start: bytes) -> str:
    """Send the start of a request, then a byte a second, for longer than the server's limit."""
    for _ in range(_CLIENTS):
        with contextlib.suppress(OSError):
            server.connect().sendall(start)
    sockets = list(server.open)

    def drip() -> None:
        for _ in range(int(_PATIENCE_S)):
            for connection in sockets:
                with contextlib.suppress(OSError):
                    connection.send(b"a")
            time.sleep(1)

    threading.Thread(target=drip, daemon=True).start()
    return ""


def _slow_heads(server: Server) -> str:
    return _trickle(server, f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nX: ".encode())


def _slow_bodies(server: Server) -> str:
    head = f"POST /tune/closed/x HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n"
    return _trickle(server, f"{head}Content-Length: 1000000\r\n\r\n".encode())


def _large_heads(server: Server) -> str:
    head = f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nX: ".encode()
    for _ in range(20):
        answer = _exchange(server, head + b"a" * _LARGE + b"\r\n\r\n")
        if answer not in (0, 400, 431):
            return f"a head of 10 MB got {answer}"
    return ""


def _large_bodies(server: Server) -> str:
    head = f"POST / HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nContent-Length: {_LARGE}\r\n\r\n"
    for _ in range(20):
        if (answer := _exchange(server, head.encode() + bytes(_LARGE))) not in (0, 403):
            return f"a body of 10 MB without a cookie got {answer}"
    return ""


def _large_messages(server: Server) -> str:
    """Send messages of 10 MB over web sockets that the cookie opened."""
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect

    for _ in range(5):
        address = f"ws://127.0.0.1:{server.port}{_SOCKET}"
        headers = {"Cookie": server.cookie}
        with (
            connect(address, additional_headers=headers) as web_socket,
            contextlib.suppress(ConnectionClosed),
        ):
            web_socket.send("a" * _LARGE)
            for _ in range(10):
                web_socket.recv(timeout=_PATIENCE_S)
            return "a message of 10 MB was taken"
    return ""


#: Heads that are none; {} is the Host.
_MALFORMED = (
    "\r\n\r\n",
    "GET\r\n\r\n",
    "GET / HTTP/9.9\r\nHost: {}\r\n\r\n",
    "GET / HTTP/1.1\r\nHost {}\r\n\r\n",
    "GET / HTTP/1.1\r\nHost: {}\r\nHost: evil.example\r\n\r\n",
    "GET / HTTP/1.1\nHost: {}\n\n",
    "GET /\x00 HTTP/1.1\r\nHost: {}\r\n\r\n",
    "GET / HTTP/1.1\r\nHost: {}\r\nX\x00: 1\r\n\r\n",
    "POST / HTTP/1.1\r\nHost: {}\r\nContent-Length: -1\r\n\r\n",
    "POST / HTTP/1.1\r\nHost: {}\r\nContent-Length: 5\r\nContent-Length: 6\r\n\r\nabcdef",
    "POST / HTTP/1.1\r\nHost: {}\r\nContent-Length: 99999999999999999999\r\n\r\n",
    "POST / HTTP/1.1\r\nHost: {}\r\nTransfer-Encoding: chunked\r\n\r\nffffffffffffffffff\r\n",
    "POST / HTTP/1.1\r\nHost: {}\r\nTransfer-Encoding: chunked\r\nContent-Length: 4\r\n\r\n0\r\n",
    "CONNECT evil.example:80 HTTP/1.1\r\nHost: {}\r\n\r\n",
    "GET http://evil.example/ HTTP/1.1\r\nHost: {}\r\n\r\n",
    "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    "\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
    "GET /%ff%fe/../../etc/passwd HTTP/1.1\r\nHost: {}\r\n\r\n",
)


def _malformed(server: Server) -> str:
    for text in _MALFORMED:
        data = text.replace("{}", f"127.0.0.1:{server.port}").encode("latin-1")
        if not 0 <= (answer := _exchange(server, data)) < 500 or answer == 200:
            return f"{text!a:.60} got {answer}"
    return ""


def _foreign(server: Server) -> str:
    """Ask with another name of this machine, from another page, and without the cookie."""
    own, with_cookie = f"127.0.0.1:{server.port}", f"Cookie: {server.cookie}\r\n"
    upgrade = (
        "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
    )
    asked = {
        "another Host": ("/", "evil.example", with_cookie),
        "another Origin": ("/", own, f"{with_cookie}Origin: https://evil.example\r\n"),
        "no cookie": ("/", own, ""),
        "a wrong ticket": ("/?ticket=wrong", own, ""),
        "a web socket without a cookie": (_SOCKET, own, upgrade),
        "a web socket of another Origin": (
            _SOCKET,
            own,
            f"{upgrade}{with_cookie}Origin: https://evil.example\r\n",
        ),
    }
    for name, (target, host, headers) in asked.items():
        head = f"GET {target} HTTP/1.1\r\nHost: {host}\r\n{headers}\r\n"
        if (answer := _exchange(server, head.encode())) != 403:
            return f"{name} got {answer}"
    return ""


def _exchange(server: Server, data: bytes) -> int:
    """Send bytes, return the status of the answer; 0: the connection was closed without one."""
    connection = server.connect()
    with contextlib.suppress(OSError):
        connection.sendall(data)
    answer = b""
    with contextlib.suppress(OSError):
        answer = connection.recv(200)
    found = re.match(rb"HTTP/1.[01] (\d{3})", answer)
    return int(found[1]) if found else 0


#: Name -> a function of the server, which returns what is wrong; slow ones keep their connections.
FORMS: dict[str, Callable[[Server], str]] = {
    "foreign": _foreign,
    "malformed heads": _malformed,
    "large heads": _large_heads,
    "large bodies": _large_bodies,
    "large messages": _large_messages,
    "silent clients": _silent,
    "slow heads": _slow_heads,
    "slow bodies": _slow_bodies,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run each form, then SIGTERM; print a table. Returns 1 if the server failed."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.stress tuner",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument("--forms", default="", help="only forms whose names hold one of these")
    options = parser.parse_args(arguments)
    wanted = [name for name in FORMS if any(part in name for part in options.forms.split(","))]
    failures = 0
    print(f"{'form':18}{'answered after s':>17}{'peak MB':>9}  result")
    with tempfile.TemporaryDirectory(prefix="glsim-tuner-") as folder, serving(folder) as server:
        for name in wanted:
            answered_s, problem = abuse(server, FORMS[name])
            failures += bool(problem)
            said = f"FAILED: {problem}" if problem else "fine"
            print(f"{name:18}{answered_s:17.1f}{server.peak_mb():9.0f}  {said}", flush=True)
        ended_s = end(server)
        failures += ended_s > _TERM_S
        result = "FAILED: too late" if ended_s > _TERM_S else "fine"
        print(f"{'SIGTERM':18}{ended_s:17.1f}{'':9}  {result}")
    print(f"{len(wanted) + 1} forms, {failures} failures")
    return 1 if failures else 0


@contextmanager
def serving(folder: str) -> Iterator[Server]:
    """Start glsim tune in a folder, and use its ticket."""
    (Path(folder) / "small.toml").write_text(_SENSOR)
    log = Path(folder) / "log"
    command = [sys.executable, "-m", "glsim", "tune", "small.toml", "--port", "0", "--no-browser"]
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST", "NICEGUI"))}
    paths = {"GLSIM_CACHE": str(Path(folder) / "cache"), "PYTHONPATH": str(Path.cwd())}
    with log.open("wb") as out:
        process = subprocess.Popen(
            command, cwd=folder, env={**kept, **paths, "COLUMNS": "300"}, stdout=out, stderr=out
        )
    try:
        yield _enter(process, log)
    finally:
        process.kill()
        process.wait()


def _enter(process: subprocess.Popen[bytes], log: Path) -> Server:
    """Wait for the address; ask with its ticket as a browser does, for the cookie."""
    until = time.monotonic() + _START_S
    while time.monotonic() < until and process.poll() is None:
        if found := re.search(r"http://127.0.0.1:(\d+)(/\?ticket=\S+)\s", log.read_text()):
            break
        time.sleep(0.1)
    else:
        raise SystemExit(f"glsim tune does not start: {log.read_text()[-500:]}")
    client = http.client.HTTPConnection("127.0.0.1", int(found[1]), timeout=_START_S)
    client.request("GET", found[2])
    cookie = (client.getresponse().getheader("Set-Cookie") or "").partition(";")[0]
    client.close()
    return Server(process, int(found[1]), cookie)


def abuse(server: Server, form: Callable[[Server], str]) -> tuple[float, str]:
    """Run a form; return how long the user then waited for an answer, s, and what is wrong."""
    problem = form(server)
    start = time.monotonic()
    status = server.status()
    # 404: there is no such tab; it stands behind the gate.
    while status != 404 and time.monotonic() - start < _PATIENCE_S:
        time.sleep(0.5)
        status = server.status()
    waited_s = time.monotonic() - start
    server.close()
    if status != 404:
        problem = problem or f"the user got {status or 'no answer'} for {_PATIENCE_S:.0f} s"
    if server.process.poll() is not None:
        problem = f"the server ended with {server.process.returncode}"
    elif (peak_mb := server.peak_mb()) > _MEMORY_MB:
        problem = problem or f"{peak_mb:.0f} MB"
    return waited_s, problem


def end(server: Server) -> float:
    """Send SIGTERM with connections open; return how long the server then takes, s."""
    for _ in range(90):
        server.connect()
    start = time.monotonic()
    server.process.send_signal(signal.SIGTERM)
    with contextlib.suppress(subprocess.TimeoutExpired):
        server.process.wait(_PATIENCE_S)
    server.close()
    return time.monotonic() - start
