"""The agent's state as server-sent events: each change at once, at most as often as the state file is read.

A client gets the newest state and never a backlog: a slow client misses events, and one that accepts nothing for
WRITE_WITHIN_S is disconnected. So the memory of all clients is bounded by their number.
"""

from __future__ import annotations

import asyncio
import datetime
import json
from collections.abc import Callable
from typing import Final

from aiohttp import web

from robot_offload.api.agent_state import Sight, silence
from robot_offload.reporter.metrics import Counts

MAX_CLIENTS: Final = 8
"""One console per person, and unclosed browsers; each costs up to ten events of some kilobytes a second."""
RENEW_S: Final = 1.0
"""An event is sent after this time even without a change."""
COMMENT_S: Final = 15.0
"""Proxies close connections that are silent for longer than a minute or so."""
WRITE_WITHIN_S: Final = 5.0
RETRY_MS: Final = 1000
"""A browser reconnects after this time."""
HEADERS: Final = {
    "Content-Type": "text/event-stream; charset=utf-8",
    "Cache-Control": "no-cache",
    "X-Accel-Buffering": "no",
}


class Streams:
    """The clients that follow the state.

    Args:
        sight: the agent's state as last seen.
        counts: what is counted here.
        now: the steady clock in seconds.

    Attributes:
        clients: their number.
    """

    def __init__(self, sight: Callable[[], Sight], counts: Counts, now: Callable[[], float]) -> None:
        self._sight = sight
        self._counts = counts
        self._now = now
        self._changed = asyncio.Event()
        self._ending = False
        self._cut: tuple[str, str, str] = ("", "null", "null")
        self.clients = 0

    def wake(self) -> None:
        """Send the present sight to all clients."""
        changed, self._changed = self._changed, asyncio.Event()
        changed.set()

    async def close(self, _: web.Application | None = None) -> None:
        """End all streams."""
        self._ending = True
        self.wake()

    async def serve(self, request: web.Request) -> web.StreamResponse:
        """Follow the state until the client leaves, is too slow, or the reporter stops."""
        if self.clients >= MAX_CLIENTS or self._ending:
            self._counts.streams_refused += 1
            problem = f"{MAX_CLIENTS} clients follow this stream, no more can; close one, or read /state"
            return web.json_response({"problem": problem}, status=503, headers={"Retry-After": "5"})
        self.clients += 1
        try:
            response = web.StreamResponse(headers=HEADERS)
            await response.prepare(request)
            await self._feed(response)
        except TimeoutError:
            self._counts.streams_dropped += 1
            if request.transport is not None:
                request.transport.abort()
        except ConnectionError:
            pass  # the client has gone
        finally:
            self.clients -= 1
        return response

    async def _feed(self, response: web.StreamResponse) -> None:
        number, comment_s = 0, self._now() + COMMENT_S
        await self._write(response, f"retry: {RETRY_MS}\n\n")
        while not self._ending:
            changed = self._changed
            number += 1
            await self._write(response, f"id: {number}\ndata: {self.event()}\n\n")
            if self._now() >= comment_s:
                comment_s = self._now() + COMMENT_S
                await self._write(response, ": the reporter is here\n\n")
            try:
                async with asyncio.timeout(RENEW_S):
                    await changed.wait()
            except TimeoutError:
                continue

    async def _write(self, response: web.StreamResponse, text: str) -> None:
        async with asyncio.timeout(WRITE_WITHIN_S):
            await response.write(text.encode())

    def event(self) -> str:
        """Return the data of an event: one line of JSON."""
        sight = self._sight()
        problem = silence(sight, self._now())
        state, robot = ("null", "null") if problem else self._parts(sight.text)
        at = datetime.datetime.now(datetime.UTC).timestamp()
        return f'{{"at":{at:.3f},"state":{state},"robot":{robot},"problem":{json.dumps(problem or sight.problem)}}}'

    def _parts(self, text: str) -> tuple[str, str]:
        """Return the state and the robot's report in it, each as compact JSON; split once for all clients."""
        if self._cut[0] != text:
            values = json.loads(text, parse_constant=lambda _: None)  # browsers cannot read NaN
            robot = values.pop("robot", None)
            state, report = (json.dumps(part, separators=(",", ":")) for part in (values, robot))
            self._cut = (text, state, report)
        return self._cut[1], self._cut[2]
