"""The stream of the agent's state, over real connections."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import aiohttp
import pytest
from aiohttp import web

from robot_offload.api import agent_state
from robot_offload.api.agent_state import Sight, look
from robot_offload.reporter import stream
from robot_offload.reporter.handover import Handovers
from robot_offload.reporter.leaving import Leaving
from robot_offload.reporter.metrics import Counts
from robot_offload.reporter.server import application
from robot_offload.reporter.stream import MAX_CLIENTS, Streams
from tests.unit.operator.reporter.states import text

PATIENCE_S = 60


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A busy machine makes no silent agent: what counts as one is 60 s old."""
    monkeypatch.setattr(agent_state, "FRESH_S", 30.0)


class Served:
    """A reporter's server with a state that the test sets."""

    def __init__(self) -> None:
        self.sight, self.counts, self.url = Sight(), Counts(), ""
        self.streams = Streams(lambda: self.sight, self.counts, time.monotonic)

    def say(self, content: str) -> None:
        self.sight = look(self.sight, content, time.monotonic())
        self.streams.wake()


@asynccontextmanager
async def serving() -> AsyncIterator[tuple[Served, aiohttp.ClientSession]]:
    served = Served()
    handovers = Handovers(Path("handover"), lambda: served.sight, time.monotonic)
    leaving = Leaving(Path(), lambda: served.sight, time.monotonic)
    app = application(lambda: served.sight, served.counts, handovers, leaving, "proof", served.streams, time.monotonic)
    runner = web.AppRunner(app, access_log=None)
    await runner.setup()
    site = web.TCPSite(runner, "127.0.0.1", 0)
    await site.start()
    served.url = f"http://127.0.0.1:{runner.addresses[0][1]}/stream"
    try:
        async with aiohttp.ClientSession(read_bufsize=2**20) as session:
            yield served, session
    finally:
        await runner.cleanup()


def run(story: Callable[[], Coroutine[Any, Any, None]]) -> None:
    async def patient() -> None:
        async with asyncio.timeout(PATIENCE_S):
            await story()

    asyncio.run(patient())


async def event(answer: aiohttp.ClientResponse, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The next event that is wanted."""
    async for line in answer.content:
        if line.startswith(b"data: "):
            found: dict[str, Any] = json.loads(line.removeprefix(b"data: "))
            if wanted(found):
                return found
    raise AssertionError("the stream has ended")


def test_each_change_of_the_state_is_an_event() -> None:
    async def story() -> None:
        async with serving() as (served, session), session.get(served.url) as answer:
            assert answer.headers["Content-Type"].startswith("text/event-stream")
            assert (answer.headers["Cache-Control"], answer.headers["X-Accel-Buffering"]) == ("no-cache", "no")
            first = await event(answer, lambda _: True)
            assert (first["state"], first["robot"]) == (None, None)
            assert first["problem"] == "the agent has not written its state yet"
            for epoch in (12, 13):
                served.say(text(epoch=epoch, robot={"version": 1, "loop": 7}))
                found = await event(answer, lambda found: found["state"] is not None)
                assert (found["state"]["epoch"], found["robot"]["loop"], found["problem"]) == (epoch, 7, "")
                assert "robot" not in found["state"]
                assert found["at"] > 1.7e9

    run(story)


def test_an_unchanged_state_comes_again_and_a_dead_agents_is_not_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "RENEW_S", 0.02)
    monkeypatch.setattr(stream, "COMMENT_S", 0.02)

    async def story() -> None:
        async with serving() as (served, session):
            served.say(text())
            async with session.get(served.url) as answer:
                lines = [await answer.content.readline() for _ in range(24)]
                assert sum(line.startswith(b"data: ") for line in lines) > 2
                assert any(line.startswith(b": ") for line in lines)
                numbers = [int(line[4:]) for line in lines if line.startswith(b"id: ")]
                assert numbers == sorted(set(numbers))
                served.sight = look(Sight(), text(), time.monotonic() - 60)
                dead = await event(answer, lambda found: found["state"] is None)
                assert "has written nothing new for" in dead["problem"]

    run(story)


def test_a_number_that_is_none_is_null_for_a_browser() -> None:
    served = Served()
    served.say(text(link={"latency_ms": float("nan")}))
    assert json.loads(served.streams.event(), parse_constant=pytest.fail)["state"]["link"] == {"latency_ms": None}


def test_more_clients_than_there_is_room_for_are_refused_until_one_leaves() -> None:
    async def story() -> None:
        async with serving() as (served, session):
            answers = [await session.get(served.url) for _ in range(MAX_CLIENTS)]
            async with session.get(served.url) as refused:
                assert refused.status == 503
                assert "no more can" in (await refused.json())["problem"]
            assert served.counts.streams_refused == 1
            answers.pop().close()
            while served.streams.clients == MAX_CLIENTS:  # noticed at the next writing
                served.say(text(epoch=time.monotonic_ns() % 1000))
                await asyncio.sleep(0.01)
            async with session.get(served.url) as welcome:
                assert welcome.status == 200
            for answer in answers:
                answer.close()

    run(story)


def test_a_client_that_reads_nothing_is_hung_up_on_and_the_others_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "WRITE_WITHIN_S", 0.5)

    async def story() -> None:
        async with serving() as (served, session):
            host, port = served.url.removeprefix("http://").removesuffix("/stream").split(":")
            _, writer = await asyncio.open_connection(host, int(port), limit=1024)
            writer.write(b"GET /stream HTTP/1.1\r\nHost: reporter\r\n\r\n")
            async with session.get(served.url) as answer:
                number = 0
                while not served.counts.streams_dropped:
                    number += 1
                    served.say(text(epoch=number, message="x" * 30_000))
                    found = await event(answer, lambda found: found["state"] is not None)
                    assert found["state"]["epoch"] <= number
                assert served.streams.clients == 1
            writer.close()

    run(story)


def test_a_reporter_that_stops_ends_its_streams_at_once() -> None:
    async def story() -> None:
        async with serving() as (served, session):
            served.say(text())
            answer = await session.get(served.url)
            await event(answer, lambda _: True)
            await served.streams.close()
            assert (await answer.read()).count(b"data: ") <= 1

    run(story)
