"""The tuner's page opens with its token alone; its last settings are kept after the command."""

import queue
import socket
import webbrowser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("nicegui", reason="the extra glsim[tune] is not installed")

from starlette.applications import Starlette
from starlette.responses import PlainTextResponse
from starlette.routing import Route, WebSocketRoute
from starlette.testclient import TestClient
from starlette.websockets import WebSocket, WebSocketDisconnect

from glsim.cli.tune_page.access import AccessCheck, cookie_secret, keep_tuning, kept_tuning, listen
from glsim.cli.tune_page.tuning import Tuning
from glsim.core.errors import ConfigError
from glsim.core.files.cache_folder import cache_folder
from glsim.faces.model_cache import cached_arrays

START = Tuning("kinect-v1")


@pytest.fixture
def client() -> Any:
    """A client of a guarded page, at the address that the command printed."""

    async def answer(_: Any) -> PlainTextResponse:
        return PlainTextResponse("the page")

    async def talk(opened: WebSocket) -> None:
        await opened.accept()
        await opened.send_text("hello")

    app = Starlette(routes=[Route("/", answer), WebSocketRoute("/talk", talk)])
    address = listen("127.0.0.1", 0)
    with address.listening:
        guarded = AccessCheck(app, address, "secret")
        client: Any = TestClient(guarded, f"http://127.0.0.1:{address.port}")
        client.token = address.token
        client.talk = f"ws://127.0.0.1:{address.port}/talk"
        yield client


def test_a_token_becomes_a_cookie_that_opens_pages_and_sockets(client: Any) -> None:
    assert client.get("/").status_code == 403
    came = client.get(f"/?token={client.token}&tab=1", follow_redirects=False)
    assert came.headers["location"].endswith("/?tab=1")
    assert "HttpOnly" in came.headers["set-cookie"]
    page = client.get("/")
    assert page.text == "the page"
    assert page.headers["content-security-policy"] == "frame-ancestors 'none'"
    with client.websocket_connect(client.talk) as opened:
        assert opened.receive_text() == "hello"


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"host": "localhost:9000"}, 200),  # through ssh -L
        ({"host": "evil.example:8137"}, 403),  # a name that leads to 127.0.0.1
        ({"host": "[evil"}, 403),
        ({"origin": "http://127.0.0.1:1"}, 403),
        ({"origin": "https://evil.example"}, 403),
        ({"origin": "null"}, 403),
        ({"cookie": ""}, 403),
        ({"cookie": "glsim_tune=secret"}, 403),
    ],
)
def test_other_origins_names_and_cookies_are_refused(
    client: Any, headers: dict[str, str], status: int
) -> None:
    cookie = f"glsim_tune_{client.base_url.port}=secret"
    headers = {"cookie": cookie} | headers
    assert client.get("/", headers=headers).status_code == status
    assert client.get("/?token=wrong", headers=headers).status_code == status
    if status == 403:
        with (
            pytest.raises(WebSocketDisconnect),
            client.websocket_connect(client.talk, headers=headers) as opened,
        ):
            opened.receive_text()


def test_a_port_in_use_gives_a_free_one_and_a_foreign_host_is_refused() -> None:
    with listen("127.0.0.1", 0).listening as taken:
        wanted = taken.getsockname()[1]
        with listen("127.0.0.1", wanted).listening as other:
            assert other.getsockname()[1] != wanted
            with socket.create_connection(other.getsockname()):  # before a server is up
                pass
    with pytest.raises(ConfigError, match=r"--host 192\.0\.2\.1 --port 8137: "):
        listen("192.0.2.1", 8137)


def test_the_browser_is_given_a_private_file_and_no_token(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Everybody on the machine can read the arguments of the browser's process."""
    opened: queue.Queue[str] = queue.Queue()
    monkeypatch.setattr(webbrowser, "open", opened.put)
    monkeypatch.setenv("GLSIM_CACHE", str(tmp_path))
    address = listen("127.0.0.1", 0)
    with address.listening:
        address.open_browser()
        given = opened.get()
        page = Path(given.removeprefix("file://"))
        assert address.token not in given
        assert page.stat().st_mode & 0o777 == 0o600
        assert address.url in page.read_text()


def test_the_last_settings_are_kept_in_a_private_file(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GLSIM_CACHE", str(here / "cache"))
    assert kept_tuning(START, "render a.obj") is None
    secret = cookie_secret()
    changed = START.with_value("axial.angle_mm", 2)
    keep_tuning(START, "render a.obj", changed)
    assert kept_tuning(START, "render a.obj") == changed
    assert kept_tuning(START, "render b.obj") is None
    assert kept_tuning(Tuning("ideal"), "render a.obj") is None
    assert cookie_secret() == secret
    file = here / "cache" / "tune.json"
    assert file.stat().st_mode & 0o777 == 0o600
    for damaged in ("{", "[]", '{"tunings": {}}', '{"tunings": 3, "secret": 3}'):
        file.write_text(damaged)
        assert kept_tuning(START, "render a.obj") is None
        assert len(cookie_secret()) == 32
        keep_tuning(START, "render a.obj", changed)
        assert kept_tuning(START, "render a.obj") == changed
    (here / "no folder").write_text("")
    monkeypatch.setenv("GLSIM_CACHE", str(here / "no folder"))
    keep_tuning(START, "", changed)
    assert len(cookie_secret()) == 32


def test_a_user_without_a_home_keeps_nothing_and_may_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("GLSIM_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)

    def home() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", home)
    with pytest.raises(ConfigError, match="set GLSIM_CACHE to a folder"):
        cache_folder()
    assert cookie_secret() != cookie_secret()
    keep_tuning(START, "tune", START)
    assert kept_tuning(START, "tune") is None
    assert cached_arrays("model", lambda: {"points": np.ones(3)})["points"].sum() == 3
