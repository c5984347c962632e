"""Access to the pages: only for a browser of this machine that was given the address with the token.

The token protects against other users of the machine. Against a web page elsewhere that reaches for this port (DNS
rebinding, forged requests): the Host header must name the loopback, and an Origin, if present, must be ours.
"""

from __future__ import annotations

import hmac
from http.cookies import CookieError, SimpleCookie
from typing import Final
from urllib.parse import parse_qsl, urlencode

from starlette.types import ASGIApp, Receive, Scope, Send

NAMES: Final = ("127.0.0.1", "localhost")
HTTP: Final = "http"
WEBSOCKET: Final = "websocket"
POLICY_VIOLATION: Final = 1008
"""The code with which a websocket is refused, RFC 6455."""


class Guard:
    """Pass on requests that come from a page of ours.

    Args:
        app: what it protects.
        token: the secret of the address.
        port: of the pages.
    """

    def __init__(self, app: ASGIApp, token: str, port: int) -> None:
        self._app = app
        self._token = token
        self._hosts = {f"{name}:{port}".encode() for name in NAMES}
        self._origins = {b"http://" + host for host in self._hosts}
        self._cookie = f"robot-offload-console-{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on, redirect to the address without the token, or refuse."""
        if scope["type"] not in (HTTP, WEBSOCKET):
            await self._app(scope, receive, send)
            return
        headers: dict[bytes, list[bytes]] = {}
        for name, value in scope["headers"]:
            headers.setdefault(name, []).append(value)
        if not _all_in(headers.get(b"host", [b""]), self._hosts):
            await _refuse(scope, send, "this console answers to 127.0.0.1 and localhost only")
        elif not _all_in(headers.get(b"origin", []), self._origins):
            await _refuse(scope, send, "a page of another address may not use this console")
        elif self._given(scope):
            await self._welcome(scope, send)
        elif not self._known(b"; ".join(headers.get(b"cookie", []))):
            await _refuse(scope, send, "open the address with the token that the command has printed")
        else:
            await self._app(scope, receive, send)

    def _given(self, scope: Scope) -> bool:
        """Return whether a request for a page carries the token in its address."""
        tokens = [value for name, value in parse_qsl(scope["query_string"].decode("latin-1")) if name == "token"]
        return scope["type"] == HTTP and any(self._same(token) for token in tokens)

    def _known(self, header: bytes) -> bool:
        try:
            found = SimpleCookie(header.decode("latin-1")).get(self._cookie)
        except CookieError:
            return False
        return found is not None and self._same(found.value)

    def _same(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self._token.encode())

    async def _welcome(self, scope: Scope, send: Send) -> None:
        """Keep the token in a cookie, so that it is not in the browser's history, and show the page itself."""
        rest = [(name, value) for name, value in parse_qsl(scope["query_string"].decode("latin-1")) if name != "token"]
        # One slash: a path that begins with two would address another host.
        path = "/" + str(scope["path"]).lstrip("/\\")
        place = f"{path}?{urlencode(rest)}" if rest else path
        cookie = f"{self._cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict"
        headers = [
            (b"location", place.encode("ascii", "ignore")),
            (b"set-cookie", cookie.encode()),
            (b"referrer-policy", b"no-referrer"),
        ]
        await send({"type": "http.response.start", "status": 303, "headers": headers})
        await send({"type": "http.response.body", "body": b""})


def _all_in(values: list[bytes], known: set[bytes]) -> bool:
    """Return whether each value of a header, which may be repeated, is a known one."""
    return all(value in known for value in values)


async def _refuse(scope: Scope, send: Send, reason: str) -> None:
    if scope["type"] == WEBSOCKET:
        await send({"type": "websocket.close", "code": POLICY_VIOLATION, "reason": reason})
        return
    headers = [(b"content-type", b"text/plain; charset=utf-8")]
    await send({"type": "http.response.start", "status": 403, "headers": headers})
    await send({"type": "http.response.body", "body": f"403: {reason}\n".encode()})
