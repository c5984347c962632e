"""A stand-in for a container registry: what `buildah push` and `pull` ask of one, in memory, behind a password."""

from __future__ import annotations

import base64
import hashlib
import re
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, ClassVar
from urllib.parse import parse_qs, urlsplit

USER, PASSWORD = "robot", "s3cret"
_ALLOWED = "Basic " + base64.b64encode(f"{USER}:{PASSWORD}".encode()).decode()


class PretendedRegistry:
    """A registry on this machine, over plain HTTP. It refuses everybody who does not know the password.

    Attributes:
        address: `host:port`.
        manifests: what was pushed, by `name:tag` and `name@digest`.
    """

    def __init__(self) -> None:
        self.blobs: dict[str, bytes] = {}
        self.manifests: dict[str, tuple[str, bytes]] = {}
        self.uploads: dict[str, bytes] = {}
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), type("Handler", (_Handler,), {"registry": self}))
        self.address = f"127.0.0.1:{self._server.server_address[1]}"
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends it."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


def digest_of(content: bytes) -> str:
    """The name of a content."""
    return f"sha256:{hashlib.sha256(content).hexdigest()}"


class _Handler(BaseHTTPRequestHandler):
    """Answers one connection."""

    registry: ClassVar[PretendedRegistry]
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        self._read()
        if not self._known():
            return
        if self.path == "/v2/":
            self._answer(200)
        elif found := re.fullmatch(r"/v2/(.+)/blobs/(sha256:[0-9a-f]{64})", self.path):
            self._content("application/octet-stream", self.registry.blobs.get(found[2]))
        elif found := re.fullmatch(r"/v2/(.+)/manifests/(.+)", self.path):
            kind, content = self.registry.manifests.get(_name(found[1], found[2]), ("", None))
            self._content(kind, content)
        else:
            self._answer(404)

    def do_HEAD(self) -> None:
        self.do_GET()

    def do_POST(self) -> None:
        self._read()
        if self._known():
            upload = f"{urlsplit(self.path).path}{len(self.registry.uploads)}"
            self.registry.uploads[upload] = b""
            self._answer(202, Location=upload)

    def do_PATCH(self) -> None:
        content = self._read()
        if self._known():
            self.registry.uploads[self.path] += content
            self._answer(202, Location=self.path, Range=f"0-{len(self.registry.uploads[self.path]) - 1}")

    def do_PUT(self) -> None:
        content = self._read()
        if not self._known():
            return
        url = urlsplit(self.path)
        if found := re.fullmatch(r"/v2/(.+)/manifests/(.+)", url.path):
            entry = self.headers["Content-Type"], content
            names = (_name(found[1], found[2]), _name(found[1], digest_of(content)))
            self.registry.manifests |= dict.fromkeys(names, entry)
            self._answer(201, **{"Docker-Content-Digest": digest_of(content)})
            return
        blob = self.registry.uploads.pop(url.path) + content
        [wanted] = parse_qs(url.query)["digest"]
        if digest_of(blob) != wanted:
            self._answer(400)
            return
        self.registry.blobs[wanted] = blob
        self._answer(201, **{"Docker-Content-Digest": wanted})

    def _known(self) -> bool:
        if self.headers.get("Authorization") == _ALLOWED:
            return True
        self._answer(401, **{"WWW-Authenticate": 'Basic realm="pretended"'})
        return False

    def _read(self) -> bytes:
        if self.headers.get("Transfer-Encoding") != "chunked":
            return self.rfile.read(int(self.headers.get("Content-Length") or 0))
        content = b""
        while size := int(self.rfile.readline().split(b";")[0], 16):
            content += self.rfile.read(size)
            self.rfile.readline()
        self.rfile.readline()
        return content

    def _content(self, kind: str, content: bytes | None) -> None:
        if content is None:
            self._answer(404)
            return
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Docker-Content-Digest", digest_of(content))
        self.end_headers()
        if self.command == "GET":
            self.wfile.write(content)

    def _answer(self, code: int, **headers: str) -> None:
        self.send_response(code)
        for name, value in headers.items():
            self.send_header(name, value)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_message(self, *_: Any) -> None:
        """Nothing: a test says itself what it has seen."""


def _name(repository: str, reference: str) -> str:
    return f"{repository}{'@' if reference.startswith('sha256:') else ':'}{reference}"
