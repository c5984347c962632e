"""What kopf asks the API server passes one door: counted, fenced, and without keys of certificates."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import Awaitable, Callable

import aiohttp
import pytest
from aiohttp import web

from robot_offload.kube.configuration import Credentials
from robot_offload.kube.errors import NotLeaderError
from robot_offload.kube.port import Verb
from robot_offload.runtime.session import session

SECRETS = "/api/v1/secrets"
PODS = "/api/v1/namespaces/fleet/pods"


def asked(
    ask: Callable[[aiohttp.ClientSession, str], Awaitable[None]], guard: Callable[[Verb], None] = lambda _: None
) -> tuple[list[tuple[str, str]], list[str]]:
    """Returns path and accepted form of what arrives at a real server, and the streams that were opened."""
    arrived: list[tuple[str, str]] = []
    opened: list[str] = []

    async def answer(request: web.Request) -> web.Response:
        assert request.headers["Authorization"] == "Bearer t"
        arrived.append((request.path, request.headers["Accept"]))
        return web.json_response({"items": None}, status=403 if "forbidden" in request.path else 200)

    async def main() -> None:
        application = web.Application()
        application.router.add_route("*", "/{path:.*}", answer)
        runner = web.AppRunner(application)
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        address = f"http://127.0.0.1:{runner.addresses[0][1]}"
        known = Credentials(address, {"Authorization": "Bearer t"}, ssl.create_default_context(), False, None)
        kopfs = session(known, guard, opened.append)
        assert kopfs.server == address
        try:
            await ask(kopfs.aiohttp_session, address)
        finally:
            await kopfs.aiohttp_session.close()
            await runner.cleanup()

    asyncio.run(main())
    return arrived, opened


def test_secrets_are_listed_and_watched_as_metadata() -> None:
    async def ask(http: aiohttp.ClientSession, address: str) -> None:
        for path in (SECRETS, f"{SECRETS}?watch=true", PODS):
            async with http.get(address + path):
                pass

    arrived, opened = asked(ask)
    (_, listed), (_, watched), (_, pods) = arrived
    assert "as=PartialObjectMetadataList" in listed
    assert "as=PartialObjectMetadata;" in watched
    assert pods == "*/*"
    assert opened == [SECRETS]


def test_an_empty_list_of_metadata_is_an_empty_list() -> None:
    found = []

    async def ask(http: aiohttp.ClientSession, address: str) -> None:
        async with http.get(address + SECRETS) as answer:
            found.append(await answer.json())

    asked(ask)
    assert found == [{"items": []}]


def test_a_stream_that_is_refused_may_have_missed_something_as_well() -> None:
    async def ask(http: aiohttp.ClientSession, address: str) -> None:
        async with http.get(f"{address}/forbidden?watch=true"):
            pass

    assert asked(ask)[1] == ["/forbidden"]


def test_who_does_not_lead_writes_nothing_through_kopf_either() -> None:
    verbs: list[Verb] = []

    def guard(verb: Verb) -> None:
        verbs.append(verb)
        if verb == "create":
            raise NotLeaderError("another operator is the leader")

    async def ask(http: aiohttp.ClientSession, address: str) -> None:
        async with http.get(f"{address}{PODS}?watch=true"):
            pass
        with pytest.raises(NotLeaderError):
            await http.post(f"{address}/api/v1/namespaces/fleet/events", json={})

    arrived, _ = asked(ask, guard)
    assert verbs == ["watch", "create"]
    assert [path for path, _ in arrived] == [PODS]
