"""Who gets through to the pages: the browser that has the token, and nobody who merely reaches the port."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from robot_offload.console.guard import Guard

TOKEN, PORT = "a-secret", 8123
HOST = (b"host", b"127.0.0.1:8123")
COOKIE = (b"cookie", b"other=1; robot-offload-console-8123=a-secret")


def ask(*headers: tuple[bytes, bytes], query: str = "", kind: str = "http", path: str = "/") -> dict[str, Any]:
    """The first answer to a request; the protected application answers with 200."""
    sent: list[Any] = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        await send({"type": "passed"})

    async def send(message: Any) -> None:
        sent.append(message)

    async def receive() -> Any:
        return {}

    scope = {"type": kind, "path": path, "query_string": query.encode(), "headers": list(headers)}
    asyncio.run(Guard(app, TOKEN, PORT)(scope, receive, send))
    return dict(sent[0])


def test_the_address_with_the_token_leads_to_the_page_without_it_and_leaves_a_cookie() -> None:
    answer = ask(HOST, query="token=a-secret&x=1")
    headers = dict(answer["headers"])
    assert answer["status"] == 303
    assert headers[b"location"] == b"/?x=1"
    assert b"HttpOnly; SameSite=Strict" in headers[b"set-cookie"]


def test_the_cookie_opens_pages_and_the_websocket() -> None:
    assert ask(HOST, COOKIE)["type"] == "passed"
    origin = (b"origin", b"http://127.0.0.1:8123")
    assert ask(HOST, COOKIE, origin, kind="websocket")["type"] == "passed"


@pytest.mark.parametrize(
    ("headers", "query"),
    [
        ((HOST,), ""),
        ((HOST,), "token=wrong"),
        ((HOST, (b"cookie", b"robot-offload-console-8123=wrong")), ""),
        ((HOST, (b"cookie", b"\xff\xfe;;==")), ""),
        ((COOKIE,), ""),
        (((b"host", b"attacker.example:8123"), COOKIE), ""),
        (((b"host", b"attacker.example:8123"),), "token=a-secret"),
        ((HOST, COOKIE, (b"origin", b"http://attacker.example")), ""),
        ((HOST, COOKIE, (b"origin", b"null")), ""),
    ],
)
def test_anybody_else_is_refused(headers: tuple[tuple[bytes, bytes], ...], query: str) -> None:
    assert ask(*headers, query=query)["status"] == 403
    refused = ask(*headers, query=query, kind="websocket")
    assert (refused["type"], refused["code"]) == ("websocket.close", 1008)


def test_a_path_that_names_another_host_leads_nowhere_else() -> None:
    headers = dict(ask(HOST, query="token=a-secret", path="//attacker.example/")["headers"])
    assert headers[b"location"] == b"/attacker.example/"


def test_a_header_that_comes_twice_is_judged_by_all_of_its_values() -> None:
    twice = ((b"host", b"attacker.example"), HOST)
    assert ask(*twice, COOKIE)["status"] == 403
