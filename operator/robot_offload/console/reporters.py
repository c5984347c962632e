"""Reports read through the API server's proxy: a stream for a robot whose page is open, else polled.

A fleet is polled in turn: two hundred robots cost fifty small requests a second, and no reporter gets more than one
every few seconds.
"""

from __future__ import annotations

import asyncio
import datetime
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from robot_offload.console.live import Key
from robot_offload.console.model import Said, Trouble
from robot_offload.console.reading import EventError, of_event, of_state
from robot_offload.console.source import Publish
from robot_offload.kube.errors import ForbiddenError, KubeError, NotFoundError, UnreachableError
from robot_offload.kube.pages import REPORTER_PORT, answered, proxied, read_page
from robot_offload.kube.port import KubeApi, Manifest
from robot_offload.objects.names import AGENT, child_name

POLLS_PER_S: Final = 50.0
POLL_S: Final = 2.0
"""Least time between two requests to a reporter whose page is closed."""
AT_ONCE: Final = 16
"""Requests in flight: slow reporters delay the others only if this many are slow."""
AGAIN_S: Final = 1.0
IDLE_S: Final = 20.0
"""A stream brings something each second, and a comment every 15 s."""
DATA: Final = b"data: "
OLDER: Final = "the reporter is older and offers no stream; its state is asked for once a second"


class Reporters:
    """Reads all reporters.

    Args:
        api: a connection with the user's identity.
        there: the existing robots; the caller keeps it current.
        watched: how many pages of each robot are open; the caller keeps it current.
    """

    def __init__(self, api: KubeApi, there: Mapping[Key, Manifest], watched: Counter[Key]) -> None:
        self._api = api
        self._there = there
        self._watched = watched
        self._streams: dict[Key, asyncio.Task[None]] = {}
        self._asking = asyncio.Semaphore(AT_ONCE)
        self._asked: set[Key] = set()

    async def run(self, publish: Publish) -> None:
        """Stream and poll until cancelled."""
        loop = asyncio.get_running_loop()
        due_s: dict[Key, float] = {}
        async with asyncio.TaskGroup() as tasks:
            while True:
                for key in list(self._there):
                    wanted = self._watched[key] > 0
                    stream = self._streams.get(key)
                    if wanted and (stream is None or stream.done()):
                        self._streams[key] = tasks.create_task(self._follow(key, publish))
                    elif not wanted and key not in self._asked and loop.time() >= due_s.get(key, 0.0):
                        due_s[key] = loop.time() + max(POLL_S, len(self._there) / POLLS_PER_S)
                        self._asked.add(key)
                        tasks.create_task(self._ask_in_turn(key, publish))
                        await asyncio.sleep(1 / POLLS_PER_S)
                await asyncio.sleep(0.1)

    async def _follow(self, key: Key, publish: Publish) -> None:
        """Follow one stream for as long as a page of this robot is open."""
        while self._watched[key] > 0 and key in self._there:
            try:
                async for line in self._api.lines(_url(key, "stream"), idle_s=IDLE_S):
                    if line.startswith(DATA):
                        self._hear(key, line[len(DATA) :], publish)
                    if self._watched[key] <= 0 or key not in self._there:
                        return
            except NotFoundError:
                await self._ask(key, publish, OLDER)
            except KubeError as error:
                publish(Trouble(key, problem(error, key)))
            await asyncio.sleep(AGAIN_S)

    def _hear(self, key: Key, data: bytes, publish: Publish) -> None:
        try:
            at_s, live = of_event(data.decode(errors="replace"))
        except EventError as error:
            publish(Trouble(key, str(error)))
        else:
            publish(Said(key, at_s, live))

    async def _ask_in_turn(self, key: Key, publish: Publish) -> None:
        try:
            async with self._asking:
                await self._ask(key, publish)
        finally:
            self._asked.discard(key)

    async def _ask(self, key: Key, publish: Publish, note: str = "") -> None:
        """Ask one reporter for its state."""
        try:
            state = await read_page(self._api, _url(key, "state"))
            if state is None:
                publish(Trouble(key, "there is no cloud agent; shown is the resource's status"))
                return
            robot = state.pop("robot", None)
            now_s = datetime.datetime.now(datetime.UTC).timestamp()
            publish(Said(key, now_s, replace(of_state(state, robot), note=note)))
        except EventError as error:
            publish(Trouble(key, str(error)))
        except KubeError as error:
            publish(Trouble(key, problem(error, key)))


def problem(error: KubeError, key: Key) -> str:
    """Return why there are no live numbers, for people; the page then shows the resource."""
    if isinstance(error, ForbiddenError):
        return f"you may not get services/proxy in namespace {key.namespace}; shown is the resource's status"
    if isinstance(error, UnreachableError):
        return "the API server does not answer"
    return f"{answered(error)}; shown is the resource's status"


def _url(key: Key, page: str) -> str:
    return proxied(key.namespace, child_name(key.name, AGENT), REPORTER_PORT, page)
