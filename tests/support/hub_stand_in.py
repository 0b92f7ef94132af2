"""A local server with the HTTP interface of the Hugging Face Hub, for one data set.

Written after the requests of huggingface_hub: create a repository, ask how files are sent, store
large files by Git LFS' batch interface, commit. It keeps what a commit names.
"""

from __future__ import annotations

import base64
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

TOKEN = "hf_of_a_test"  # no token of anybody


@dataclass
class HubStandIn:
    """The state of the server: repositories, stored objects, and committed files."""

    url: str = ""
    repositories: dict[str, bool] = field(default_factory=dict)  # name -> private
    objects: dict[str, bytes] = field(default_factory=dict)  # SHA-256 -> bytes
    files: dict[str, bytes] = field(default_factory=dict)
    commits: int = 0
    requests: list[str] = field(default_factory=list)


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    @property
    def hub(self) -> HubStandIn:
        return self.server.hub  # type: ignore[attr-defined, no-any-return]

    def log_message(self, *_: object) -> None:
        """Print nothing."""

    def _body(self) -> bytes:
        if self.headers.get("Transfer-Encoding") == "chunked":
            parts = []
            while size := int(self.rfile.readline(), 16):
                parts.append(self.rfile.read(size))
                self.rfile.readline()
            self.rfile.readline()
            return b"".join(parts)
        return self.rfile.read(int(self.headers.get("Content-Length", 0)))

    def _answer(self, content: Any, status: int = 200) -> None:
        data = json.dumps(content).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        if self.command != "HEAD":  # HTTP allows no body after HEAD
            self.wfile.write(data)

    def do_PUT(self) -> None:
        self.hub.objects[self.path.rsplit("/", 1)[1]] = self._body()
        self._answer({})

    def do_GET(self) -> None:
        self.hub.requests.append(f"GET {self.path}")
        self._answer({"error": "no such page"}, 404)

    do_HEAD = do_GET  # noqa: N815

    def do_POST(self) -> None:
        body, path = self._body(), self.path.partition("?")[0]
        self.hub.requests.append(f"POST {path}")
        if self.headers.get("Authorization") not in (f"Bearer {TOKEN}", None):
            self._answer({"error": "Invalid credentials in Authorization header"}, 401)
        elif path == "/api/repos/create":
            asked = json.loads(body)
            name = f"{asked['organization']}/{asked['name']}"
            if name in self.hub.repositories:
                url = f"{self.hub.url}/datasets/{name}"
                self._answer({"error": "You already created this repo", "url": url}, 409)
                return
            private = asked.get("private", asked.get("visibility") == "private")
            self.hub.repositories[name] = bool(private)
            self._answer({"url": f"{self.hub.url}/datasets/{name}"})
        elif path == "/api/validate-yaml":
            self._answer({"errors": [], "warnings": []})
        elif "/preupload/" in path:
            files = json.loads(body)["files"]
            self._answer({"files": [
                {"path": f["path"], "shouldIgnore": False,
                 "uploadMode": "lfs" if f["path"].endswith((".png", ".tar")) else "regular"}
                for f in files
            ]})  # fmt: skip
        elif path.endswith("/info/lfs/objects/batch"):
            objects = json.loads(body)["objects"]
            self._answer({"transfer": "basic", "objects": [
                {"oid": o["oid"], "size": o["size"]} if o["oid"] in self.hub.objects else
                {"oid": o["oid"], "size": o["size"],
                 "actions": {"upload": {"href": f"{self.hub.url}/store/{o['oid']}"}}}
                for o in objects
            ]})  # fmt: skip
        elif "/commit/" in path:
            self.hub.commits += 1
            for line in map(json.loads, body.splitlines()):
                value = line["value"]
                if line["key"] == "file":
                    self.hub.files[value["path"]] = base64.b64decode(value["content"])
                elif line["key"] == "lfsFile":
                    self.hub.files[value["path"]] = self.hub.objects[value["oid"]]
            url = f"{self.hub.url}/datasets/me/faces/commit/{self.hub.commits}"
            self._answer({"success": True, "commitOid": str(self.hub.commits), "commitUrl": url})
        else:
            self._answer({"error": f"no such page: {path}"}, 404)


@contextmanager
def hub_stand_in() -> Iterator[HubStandIn]:
    """Run the server during a block."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), _Handler)
    hub = HubStandIn(f"http://127.0.0.1:{server.server_address[1]}")
    server.hub = hub  # type: ignore[attr-defined]
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield hub
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
