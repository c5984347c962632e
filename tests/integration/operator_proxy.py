"""A proxy in front of the API server that counts, refuses, delays, holds, forgets, cuts and kills, as a test says.

It runs in a thread of its own and speaks plain HTTP to the operator on the loopback interface.
"""

from __future__ import annotations

import asyncio
import json
import re
import socket
import ssl
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from weakref import WeakSet

import aiohttp
from aiohttp import web

from robot_offload_lab.cluster.control_plane import ControlPlane
from tests.integration.operator_cluster import PATIENCE_S, eventually

SERVICE = re.compile(r"/api/v1/namespaces/([^/]+)/services/http:([^/:]+):\d+/proxy/(.*)")
WRITES = frozenset({"POST", "PUT", "PATCH", "DELETE"})
LEADER = "/leases/robot-offload-operator"
_HOP_BY_HOP = frozenset({"connection", "content-length", "transfer-encoding", "host"})


@dataclass(frozen=True)
class Asked:
    """One request of the operator and how it was answered."""

    method: str
    path: str
    query: str
    watch: bool
    status: int
    content: str = ""

    @property
    def write(self) -> bool:
        """Whether it changes objects. The leader's own Lease is another writer's business."""
        return self.method in WRITES and not self.leader

    @property
    def leader(self) -> bool:
        return LEADER in self.path or (self.path.endswith("/leases") and self.method == "POST")


@dataclass(frozen=True)
class Answer:
    """What the proxy answers instead of the API server."""

    status: int
    body: Any = None
    headers: tuple[tuple[str, str], ...] = ()
    hang: bool = False
    carried_out: bool = False  # whether the API server gets the request all the same

    @classmethod
    def refusal(cls, status: int, reason: str, **headers: str) -> Answer:
        body = {"kind": "Status", "apiVersion": "v1", "code": status, "reason": reason, "message": f"injected {reason}"}
        return cls(status, body, tuple((key.replace("_", "-"), value) for key, value in headers.items()))


Fault = Callable[[Asked], Answer | None]


class Proxy:
    """One proxy. Set `fault`, `hold` and `after_write` from the test at any time.

    Who comes with `kubeconfig` is the administrator, who comes with `account` has the rights that a token gives.
    """

    def __init__(self, plane: ControlPlane, directory: Path, token: str, name: str = "proxy") -> None:
        self.asked: list[Asked] = []
        self.fault: Fault | None = None
        self.hold: Callable[[Asked], threading.Event | None] | None = None
        """The answer to a request that the API server has carried out waits for this event."""
        self.after_write: Callable[[Asked], None] | None = None
        self.silent = False
        self.services: dict[str, str] = {}
        """Where the pods of Services are, by namespace/service: there is no kubelet that the API server could ask."""
        self._plane = plane
        self._watches: set[asyncio.Task[Any]] = set()
        self._streams: set[asyncio.Task[Any]] = set()
        self._unanswered: list[Asked] = []
        self._sockets: WeakSet[socket.socket] = WeakSet()
        self._loop = asyncio.new_event_loop()
        self._alone = asyncio.Lock()
        self._stopping = asyncio.Event()
        self._started = threading.Event()
        self._port = 0
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        assert self._started.wait(PATIENCE_S)
        self.kubeconfig = directory / f"{name}.kubeconfig"
        self.kubeconfig.write_text(json.dumps(self._kubeconfig(plane.token)))
        self.account = directory / f"{name}-account.kubeconfig"
        self.account.write_text(json.dumps(self._kubeconfig(token)))

    def close(self) -> None:
        self._loop.call_soon_threadsafe(self._stopping.set)
        self._thread.join(2 * PATIENCE_S)
        assert not self._thread.is_alive(), "the proxy does not end"

    def writes(self) -> list[Asked]:
        return [asked for asked in list(self.asked) if asked.write]

    def writes_in(self, namespace: str) -> list[Asked]:
        return [asked for asked in self.writes() if f"/namespaces/{namespace}/" in asked.path]

    def count_in(self, namespace: str) -> int:
        """How many requests the operator has made about a namespace, watches apart."""
        return sum(f"/namespaces/{namespace}/" in asked.path and not asked.watch for asked in list(self.asked))

    def quiet(self, namespace: str) -> None:
        """Wait until the operator has asked nothing about a namespace for a second, and has all its answers."""
        last = [self.count_in(namespace), 0]

        def look() -> bool:
            now = self.count_in(namespace)
            waits = any(f"/namespaces/{namespace}/" in asked.path for asked in list(self._unanswered))
            last[1] = last[1] + 1 if now == last[0] and not waits else 0
            last[0] = now
            return last[1] >= 20

        eventually(look, "the operator to have nothing to do")

    def cut_watches(self) -> int:
        """End all open watches in the middle; returns how many there were."""

        async def cut() -> int:
            watches = list(self._watches)
            for watch in watches:
                watch.cancel()
            return len(watches)

        return asyncio.run_coroutine_threadsafe(cut(), self._loop).result(PATIENCE_S)

    def cut_streams(self) -> None:
        """End all streams of Services."""

        async def cut() -> None:
            for stream in list(self._streams):
                stream.cancel()

        asyncio.run_coroutine_threadsafe(cut(), self._loop).result(PATIENCE_S)

    def watches(self) -> int:
        return len(self._watches)

    # -- in the thread ------------------------------------------------------------------------------------------

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.run_until_complete(self._serve())
        self._loop.run_until_complete(self._clear())
        self._loop.close()

    async def _clear(self) -> None:
        """Leave no task and no connection behind; TLS would wait for the API server's goodbye."""
        others = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)
        for one in list(self._sockets):
            with suppress(OSError):  # closed already
                one.shutdown(socket.SHUT_RDWR)
        async with asyncio.timeout(PATIENCE_S):
            while any(one.fileno() >= 0 for one in list(self._sockets)):
                await asyncio.sleep(0.01)

    def _socket(self, address: aiohttp.AddrInfoType) -> socket.socket:
        opened = socket.socket(*address[:3])
        self._sockets.add(opened)
        return opened

    async def _serve(self) -> None:
        trust = ssl.create_default_context(cafile=str(self._plane.ca_file))
        connector = aiohttp.TCPConnector(ssl=trust, limit=0, socket_factory=self._socket)
        async with aiohttp.ClientSession(connector=connector, auto_decompress=False) as self._session:
            application = web.Application(client_max_size=2**24)
            application.router.add_route("*", "/{path:.*}", self._handle)
            runner = web.AppRunner(application, access_log=None, shutdown_timeout=0.1)
            await runner.setup()
            await web.TCPSite(runner, "127.0.0.1", 0).start()
            self._port = runner.addresses[0][1]
            self._started.set()
            await self._stopping.wait()
            for task in [*self._watches, *self._streams]:
                task.cancel()
            await runner.cleanup()

    async def _handle(self, request: web.Request) -> web.StreamResponse:
        body = await request.read()
        watch = request.query.get("watch") == "true"
        asking = Asked(request.method, request.path, request.query_string, watch, 0, body.decode(errors="replace"))
        if watch:
            return await self._watch(request)
        self._unanswered.append(asking)
        try:
            return await self._answer(request, body, asking)
        finally:
            self._unanswered.remove(asking)

    async def _answer(self, request: web.Request, body: bytes, asking: Asked) -> web.StreamResponse:
        answer = self.fault(asking) if self.fault else None
        if answer is not None:
            if answer.carried_out:
                await self._forward(request, body)
            self._note(asking, answer.status)
            if answer.hang:
                await asyncio.sleep(3600)
            return web.json_response(answer.body, status=answer.status, headers=dict(answer.headers))
        served = SERVICE.fullmatch(request.path)
        if served and (url := self.services.get(f"{served[1]}/{served[2]}")):
            return await self._pass_on(request, f"{url}/{served[3]}")
        if asking.write and self.after_write:
            return await self._forward_alone(request, body, asking, self.after_write)
        status, headers, content = await self._forward(request, body)
        self._note(asking, status)
        released = self.hold(asking) if self.hold else None
        while released is not None and not released.is_set():
            await asyncio.sleep(0.02)
        return web.Response(status=status, body=content, headers=headers)

    async def _forward_alone(
        self, request: web.Request, body: bytes, asking: Asked, after: Callable[[Asked], None]
    ) -> web.StreamResponse:
        """One write after the other; those of an operator that has died meanwhile never arrive."""
        async with self._alone:
            if request.transport is None or request.transport.is_closing():
                return web.Response(status=499)
            status, headers, content = await self._forward(request, body)
            self._note(asking, status)
            if status < 300:
                after(asking)
                await asyncio.sleep(0.1)  # until its connections are seen to be closed
        return web.Response(status=status, body=content, headers=headers)

    async def _pass_on(self, request: web.Request, url: str) -> web.StreamResponse:
        """What a pod answers, for as long as it goes on."""
        task = asyncio.current_task()
        assert task is not None
        self._streams.add(task)
        try:
            async with self._session.get(url, timeout=aiohttp.ClientTimeout(total=None)) as upstream:
                response = web.StreamResponse(status=upstream.status, headers=_passed(upstream.headers))
                await response.prepare(request)
                async for chunk in upstream.content.iter_any():
                    await response.write(chunk)
                await response.write_eof()
                return response
        except (ConnectionError, aiohttp.ClientError):
            return web.Response(status=503)
        finally:
            self._streams.discard(task)

    def _note(self, asking: Asked, status: int) -> None:
        self.asked.append(Asked(asking.method, asking.path, asking.query, asking.watch, status, asking.content))

    async def _forward(self, request: web.Request, body: bytes) -> tuple[int, dict[str, str], bytes]:
        async with self._session.request(
            request.method,
            self._plane.url + request.raw_path,
            data=body or None,
            headers=_passed(request.headers),
            skip_auto_headers=("Content-Type",),
        ) as answer:
            return answer.status, _passed(answer.headers), await answer.read()

    async def _watch(self, request: web.Request) -> web.StreamResponse:
        task = asyncio.current_task()
        assert task is not None
        self._watches.add(task)
        try:
            if self.silent:
                await asyncio.sleep(3600)
            headers = {**_passed(request.headers), "Accept-Encoding": "identity"}
            timeout = aiohttp.ClientTimeout(total=None)
            async with self._session.get(
                self._plane.url + request.raw_path, headers=headers, timeout=timeout
            ) as upstream:
                response = web.StreamResponse(status=upstream.status, headers=_passed(upstream.headers))
                await response.prepare(request)
                self.asked.append(Asked("GET", request.path, request.query_string, True, upstream.status))
                async for chunk in upstream.content.iter_any():
                    if self.silent:
                        await asyncio.sleep(3600)
                    await response.write(chunk)
                await response.write_eof()
                return response
        except ConnectionError:  # the operator has gone
            return web.Response(status=500)
        finally:
            self._watches.discard(task)

    def _kubeconfig(self, token: str) -> dict[str, Any]:
        return {
            "apiVersion": "v1",
            "kind": "Config",
            "clusters": [{"name": "proxy", "cluster": {"server": f"http://127.0.0.1:{self._port}"}}],
            "users": [{"name": "admin", "user": {"token": token}}],
            "contexts": [{"name": "proxy", "context": {"cluster": "proxy", "user": "admin"}}],
            "current-context": "proxy",
        }


def _passed(headers: Any) -> dict[str, str]:
    return {key: value for key, value in headers.items() if key.lower() not in _HOP_BY_HOP}
