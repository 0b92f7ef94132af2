"""A local S3 server (moto), which can fail at chosen HTTP requests."""

import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any
from urllib.request import Request, urlopen

import pytest

BUCKET = "faces"
_SLOW_DOWN = (
    b"<Error><Code>SlowDown</Code><Message>Please reduce your request rate.</Message></Error>"
)
_FAILED = b"<Error><Code>InternalError</Code><Message>We failed.</Message></Error>"


@dataclass
class Faults:
    """The kinds of faults as shares of the requests: 0.2 strikes at every fifth.

    throttled: any request is answered 503 SlowDown. failed_puts: a PUT is answered 500 and not
    done. lost_answers: a PUT is done, and then answered 500. hidden: names (parts of keys) that no
    list shows, though the objects are there, as in a store whose lists lag. silent_s: seconds
    before each answer.
    """

    throttled: float = 0.0
    failed_puts: float = 0.0
    lost_answers: float = 0.0
    hidden: tuple[str, ...] = ()
    silent_s: float = 0.0
    counts: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._asked: dict[str, int] = {}
        self._lock = threading.Lock()

    def strikes(self, kind: str, share: float) -> bool:
        """Say whether a fault happens at a request, and count it."""
        with self._lock:
            asked = self._asked[kind] = self._asked.get(kind, 0) + 1
            hit = int(asked * share) > int((asked - 1) * share)
            self.counts[kind] = self.counts.get(kind, 0) + hit
            return hit


class S3Server:
    """The running S3 server; ``faults`` may be changed at any time."""

    def __init__(self, application: Callable[..., Any]) -> None:
        self._application = application
        self.faults = Faults()
        self.requests: list[tuple[str, str]] = []

    def __call__(self, environ: dict[str, Any], start: Callable[..., Any]) -> Iterable[bytes]:
        faults, method = self.faults, environ["REQUEST_METHOD"]
        self.requests.append((method, environ["PATH_INFO"]))
        time.sleep(faults.silent_s)
        put = method == "PUT" and environ["PATH_INFO"].count("/") > 1
        if faults.strikes("throttled", faults.throttled):
            return _answer(environ, start, "503 Slow Down", _SLOW_DOWN)
        if put and faults.strikes("failed_puts", faults.failed_puts):
            return _answer(environ, start, "500 Internal Server Error", _FAILED)
        if put and faults.strikes("lost_answers", faults.lost_answers):
            b"".join(self._application(environ, lambda *_: lambda _: None))
            # Its body is read: to wait for more would last until the client's timeout of 60 s.
            environ["CONTENT_LENGTH"] = "0"
            return _answer(environ, start, "500 Internal Server Error", _FAILED)
        if faults.hidden and "list-type=2" in environ.get("QUERY_STRING", ""):
            return self._lagging_list(environ, start)
        answer: Iterable[bytes] = self._application(environ, start)
        return answer

    def _lagging_list(self, environ: dict[str, Any], start: Callable[..., Any]) -> Iterable[bytes]:
        head: list[Any] = []
        body = b"".join(self._application(environ, lambda *words: head.extend(words[:2])))
        for name in self.faults.hidden:
            parts = body.split(b"<Contents>")
            shown = [part for part in parts[1:] if name.encode() not in part]
            gone = len(parts) - 1 - len(shown)
            if gone:
                end = parts[-1].partition(b"</Contents>")[2]
                body = (
                    parts[0]
                    + b"".join(
                        b"<Contents>" + part.partition(b"</Contents>")[0] + b"</Contents>"
                        for part in shown
                    )
                    + end
                )
                self.faults.counts["hidden"] = self.faults.counts.get("hidden", 0) + gone
        headers = [(n, v) for n, v in head[1] if n.lower() != "content-length"]
        start(head[0], [*headers, ("Content-Length", str(len(body)))])
        return [body]


def _answer(
    environ: dict[str, Any], start: Callable[..., Any], status: str, body: bytes
) -> Iterable[bytes]:
    environ["wsgi.input"].read(int(environ.get("CONTENT_LENGTH") or 0))
    headers = [("Content-Type", "application/xml"), ("Content-Length", str(len(body)))]
    start(status, headers)
    # HTTP allows no body after HEAD; a client that reads it with the head refuses the answer.
    return [] if environ["REQUEST_METHOD"] == "HEAD" else [body]


@contextmanager
def s3_server(monkeypatch: pytest.MonkeyPatch) -> Iterator[S3Server]:
    """Run an S3 server with an empty bucket; environment variables lead glsim to it."""
    server = pytest.importorskip("moto.server")
    pytest.importorskip("s3fs")
    from werkzeug.serving import make_server

    store = S3Server(server.DomainDispatcherApplication(server.create_backend_app))
    http = make_server("127.0.0.1", 0, store, threaded=True)
    thread = threading.Thread(target=http.serve_forever, daemon=True)
    thread.start()
    for name, value in {
        "AWS_ENDPOINT_URL": f"http://127.0.0.1:{http.server_port}",
        "AWS_ACCESS_KEY_ID": "key",
        "AWS_SECRET_ACCESS_KEY": "secret",
        "AWS_DEFAULT_REGION": "us-east-1",
    }.items():
        monkeypatch.setenv(name, value)
    import s3fs

    s3fs.S3FileSystem.clear_instance_cache()
    try:
        # moto keeps its buckets for as long as the process lives.
        reset = Request(f"http://127.0.0.1:{http.server_port}/moto-api/reset", method="POST")
        urlopen(reset).close()
        s3fs.S3FileSystem().mkdir(BUCKET)
        yield store
    finally:
        http.shutdown()
        thread.join()
        http.server_close()
        s3fs.S3FileSystem.clear_instance_cache()
