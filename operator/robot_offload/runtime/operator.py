"""The parts of one operator and how they work together. kopf brings the news (`handlers`); passes are made here.

The operator first waits for its kind; then it watches, becomes the leader, and works until it is stopped or a part
ends. A process that has lost a part is not repaired: it ends, and the kubelet restarts it.
"""

from __future__ import annotations

import asyncio
import contextvars
import gc
import random
import time
from collections.abc import Coroutine, Iterable
from contextlib import AsyncExitStack
from typing import Any, Final, cast

import kopf
import structlog

from robot_offload.controller.clock import Clock
from robot_offload.controller.reconcile import Controller, Name
from robot_offload.controller.store import Store
from robot_offload.decide.transitions import Transition
from robot_offload.errors import RobotOffloadError
from robot_offload.kube.configuration import credentials
from robot_offload.kube.errors import KubeError, NotFoundError, NotLeaderError
from robot_offload.kube.kinds import ROBOT_OFFLOAD
from robot_offload.kube.port import KubeApi, Manifest, Selection
from robot_offload.runtime.collector import Collector
from robot_offload.runtime.health import Limit, WatchSight
from robot_offload.runtime.http import serving
from robot_offload.runtime.leadership import Leadership, LeadersOnly
from robot_offload.runtime.metrics import Metrics
from robot_offload.runtime.queue import Queue
from robot_offload.runtime.recount import Recount
from robot_offload.runtime.session import session
from robot_offload.runtime.settings import Settings
from robot_offload.runtime.triggers import SETTLE_S, Triggers

FEED_S: Final = 30.0
"""Seconds after which passes begin although not everything is listed: one unreadable kind holds up nothing."""
_BLIND_LIMIT: Final = 2.5
"""How long the watch may miss something, in multiples of the silence after which it is reopened."""
_log = structlog.get_logger("robot_offload.runtime.operator")


class PartEndedError(RobotOffloadError):
    """A part that should run for ever has ended; the process ends with it."""


class Operator:
    """One operator, which kopf's handlers find under `memo`.

    Args:
        settings: from the environment.
        api: reads and writes for passes.
        leadership: whether this process may write.
        guard: called before each request.

    Attributes:
        settings: of the operator.
        triggers: receives news.
        sight: the watch's deliveries of RobotOffloads.
        stop: set when a part has ended: the process ends as well.
        failure: the reason; None: it was asked to stop.
        context: of one of kopf's handlers; None: none was called yet.
    """

    def __init__(self, settings: Settings, api: KubeApi, leadership: Leadership, guard: LeadersOnly) -> None:
        self.settings = settings
        self.stop = asyncio.Event()
        self.failure: RobotOffloadError | None = None
        self.context: contextvars.Context | None = None
        self._api = api
        self._clock = Clock()
        self._leadership = leadership
        self._guard = guard
        self._store = Store()
        self._controller = Controller(api, settings.images, self._clock, self._store, settings.policy, self._post)
        self._metrics = Metrics()
        self._queue: Queue[Name] = Queue(self._clock.steady_s, waited=self._metrics.waited.observe)
        self._collector = Collector(api, self._store, settings.watch_namespaces, settings.pod_namespace, settings.keep)
        self.triggers = Triggers(self._controller, self._store, self._queue, self._collector.wake)
        self.sight = WatchSight()
        places, home = settings.watch_namespaces, settings.pod_namespace
        unwatched = home if places and home not in places else None
        self._recount = Recount(api, self._store, self.triggers, places, unwatched)
        self._parts: list[asyncio.Task[None]] = []
        self._open = AsyncExitStack()
        self._probed_s = self._clock.steady_s()
        self._watching = False
        self._reached = False

    def __copy__(self) -> Operator:
        """Return itself: kopf would otherwise give each object a copy of what all share."""
        return self

    # -- for the handlers ---------------------------------------------------------------------------------------

    async def serve(self) -> None:
        """Answer probes and Prometheus until `end`."""
        self._metrics.show(
            self._statuses,
            lambda: self._guard.calls,
            lambda: len(self._queue),
            lambda: self._queue.late_s,
            lambda: self._leadership.held,
        )
        await self._open.enter_async_context(
            serving(self.settings, self._metrics.registry, self.signs, lambda: self._reached)
        )

    async def obstacle(self) -> str:
        """Return why nothing can be watched yet; empty: the API server answers and serves our kind."""
        self._leadership.alive()
        try:
            await self._list()
        except NotFoundError:
            return "The kind RobotOffload is not installed; apply its CustomResourceDefinition"
        except KubeError as error:
            return str(error)
        return ""

    def begin(self) -> None:
        """Begin to count and to wait for leadership; a waiting operator has then already read everything."""
        self._start(self._recount.run(self.settings.resync_s))
        self._start(self._lead())

    async def log_in(self) -> kopf.AiohttpSession:
        """Return a session with the present credentials."""
        return session(await credentials(), self._guard, self._recount.opened)

    async def end(self) -> None:
        """End all parts and let the next leader start at once."""
        _log.info("Stopping")
        for part in self._parts:
            part.cancel()
        await asyncio.gather(*self._parts, return_exceptions=True)
        await self._leadership.release()
        await self._open.aclose()
        self.stop.set()  # kopf would first wait for its own check of this flag

    def signs(self) -> Iterable[Limit]:
        """Yield the signs of life for /livez."""
        now_s = self._clock.steady_s()
        yield Limit("leader loop", now_s - self._leadership.looked_s, max(60.0, 4 * self.settings.lease_s))
        if self._watching:
            yield Limit("watch behind the list", self.sight.blind_s(now_s), _BLIND_LIMIT * self.settings.inactivity_s)
            yield Limit("list", now_s - self._probed_s, max(300.0, 6 * self.settings.probe_s))

    # -- the parts ----------------------------------------------------------------------------------------------

    def _start(self, part: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(part)
        task.add_done_callback(self._ended)
        self._parts.append(task)

    def _ended(self, part: asyncio.Task[None]) -> None:
        """End the process with a part that ended by itself."""
        if part.cancelled():
            return
        error = part.exception()
        if self.failure is None and isinstance(error, RobotOffloadError):
            self.failure = error
        elif self.failure is None:
            self.failure = PartEndedError(f"a part of the operator broke: {error!r}")
        self.stop.set()

    async def _lead(self) -> None:
        """Become the leader, then work."""
        await self._leadership.acquire()
        for part in (self._feed(), self._probe(), self._resync(), self._collector.run(self.settings.resync_s)):
            self._start(part)
        self._watching = True
        await self._leadership.hold()

    async def _feed(self) -> None:
        """Work on the queue: from the complete store, or until then from the API server itself."""
        try:
            async with asyncio.timeout(FEED_S):
                await self._recount.complete.wait()
            await self._learn()
        except TimeoutError:
            _log.warning("Reconciling without the cache: these kinds are not listed yet", missing=self._recount.missing)
        for _ in range(self.settings.workers):
            self._start(self._queue.work(self._look))
        if not self._store.fed:
            await self._recount.complete.wait()
            await self._learn()
        await asyncio.Event().wait()

    async def _learn(self) -> None:
        """Let passes work from the complete store."""
        await self._controller.preread(self.settings.watch_namespaces)
        self._store.fed = True
        self._controller.resume()
        # The listed objects stay: repeated garbage collection over them would delay everything.
        gc.collect()
        gc.freeze()
        _log.info("Cache is complete", objects=len(self._store))

    async def _look(self, name: Name) -> None:
        """Make one pass, with its metrics, its errors and the next time."""
        began = time.perf_counter()
        try:
            result = await self._controller.reconcile(name)
        except KubeError as error:
            self._metrics.errors.labels(error.reason).inc()
            self._metrics.reconciles.labels("error").inc()
            delay_s = self._queue.retry(name, error.retry_after_s or 0.0)
            words = {"namespace": name[0], "name": name[1], "reason": error.reason}
            _log.warning("Will try again", **words, error=str(error), after_s=delay_s)
            return
        except NotLeaderError:
            raise
        except Exception:
            # A bug about one object must not stop the service for all others; it is logged, counted and retried.
            self._metrics.errors.labels("Bug").inc()
            self._metrics.reconciles.labels("error").inc()
            _log.exception("Reconcile failed", namespace=name[0], name=name[1], after_s=self._queue.retry(name))
            return
        finally:
            self._metrics.seconds.observe(time.perf_counter() - began)
        if result.failed:
            self._metrics.reconciles.labels("refused").inc()
            self._queue.retry(name)
        else:
            self._metrics.reconciles.labels("ok").inc()
            self._queue.forgive(name)
        if result.again_s is not None:
            self._queue.remind(name, result.again_s + SETTLE_S)

    async def _probe(self) -> None:
        """Compare the watch of RobotOffloads with a list repeatedly, and process what the watch missed."""
        while True:
            await asyncio.sleep(self.settings.probe_s * random.uniform(0.9, 1.1))
            try:
                listed = await self._list()
                self._probed_s = self._clock.steady_s()
                for late in self.sight.listed(listed, self._probed_s):
                    metadata = late["metadata"]
                    found = await self._api.get(ROBOT_OFFLOAD, metadata["namespace"], metadata["name"])
                    if found is not None:
                        self.triggers.seen(ROBOT_OFFLOAD, found)
                await self._recount.look_home()
            except KubeError as error:
                _log.warning("Could not compare the watch with a list", error=str(error))

    async def _resync(self) -> None:
        """Look at every object from time to time, each at its own time, regardless of events."""
        while True:
            await asyncio.sleep(self.settings.resync_s)
            self._controller.forget_preread()
            for name in list(self._controller.memories):
                # As an event: every renewal of the robot's Lease would put off a reminder.
                self._queue.add(name, random.uniform(0, self.settings.resync_s))

    async def _list(self) -> list[Manifest]:
        """Return the metadata of all RobotOffloads."""
        found: list[Manifest] = []
        for place in self.settings.watch_namespaces or (None,):
            async for page, _ in self._api.pages(ROBOT_OFFLOAD, place, Selection(metadata_only=True)):
                found += page
        self._reached = True
        return found

    def _post(self, raw: Manifest, event: Transition) -> None:
        """Have kopf post an Event. kopf finds its queue only in the context of handlers, and passes run beside them."""
        if self.context is not None:
            about = kopf.Body(cast("kopf.RawBody", raw))
            self.context.run(lambda: kopf.event(about, type=event.type, reason=event.reason, message=event.message))

    def _statuses(self) -> Iterable[tuple[Name, dict[str, object]]]:
        return [(name, dict(memory.status)) for name, memory in self._controller.memories.items()]
